"""A model with one effect more against one without: evidence, held-out blocks, places, sizes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ropefit.effects import ContactFriction
from ropefit.inference.bins import Data
from ropefit.inference.diagnosis.evidence import Projection
from ropefit.inference.diagnosis.families import CONTACT, Family
from ropefit.inference.known import settled
from ropefit.inference.least_squares import Fit, attempted, sensitivity
from ropefit.inference.noise import Noise
from ropefit.models.equilibrium import Forward, Term

BROAD = 3.0  # usual sizes: how large an effect may well be
ANYWHERE = 0.29  # of the length: sd of a place that may be anywhere
BLOCKS = 5
SHARES = (1.0, 0.4, 0.15)  # of a start's size, until every frame settles
SLOW, SOON = (*CONTACT, ContactFriction), 6  # to settle; steps in which they must gain something
ROUNDS, WORTH, SHARE = 4, 4.0, 0.05  # of as many steps more; cost they gain, of all gained so far
FAR_OFF = 6.0  # prior sd
UNMOVED = 1e-8  # m
UNSEEN = 1.0  # sd that all data move by, by a factor e of a parameter


@dataclass
class Rival:
    """A family fitted in full: log evidence over the smaller model, and its gain by held-out block
    [nats]."""

    family: Family
    term: Term
    fit: Fit
    evidence: float
    gains: np.ndarray

    def values(self) -> np.ndarray:
        """(k + p,) in SI."""
        return self.term.value(self._mine(self.fit.point.u))

    def sd(self) -> np.ndarray:
        """(k + p,) in SI."""
        return self._mine(self.fit.sd()) * self.term.slope(self._mine(self.fit.point.u))

    def covariance(self) -> np.ndarray:
        """(k + p, k + p) of its values in search coordinates."""
        mine = self._mine(np.arange(len(self.fit.point.u)))
        return self.fit.covariance[np.ix_(mine, mine)]

    def clear(self) -> float:
        """How many standard errors its sizes are from zero, together."""
        mine, k = self._mine(self.fit.point.u), self.family.size
        nothing = self.term.search(np.zeros(self.term.size))[:k]
        covariance = self.covariance()[:k, :k]
        off = mine[:k] - nothing
        return float(np.sqrt(max(off @ np.linalg.pinv(covariance, hermitian=True) @ off, 0.0)))

    def sized(self) -> tuple[float, float]:
        """Length of a vector of sizes, and its standard error, in SI."""
        k = self.family.size
        values, slope = self.values()[:k], self.term.slope(self._mine(self.fit.point.u))[:k]
        size = float(np.linalg.norm(values))
        along = slope * values / max(size, 1e-300)
        return size, float(np.sqrt(max(along @ self.covariance()[:k, :k] @ along, 0.0)))

    def _mine(self, u: np.ndarray) -> np.ndarray:
        """The family's of the fit's values (P,), whatever was added after it."""
        forward = self.fit.forward
        parts = zip(forward.terms, forward.split(u), strict=True)
        return next(part for term, part in parts if term is self.term)


def fit_rival(
    smaller: Fit, family: Family, start: np.ndarray, data: Data, noise: Noise, bins: int
) -> Rival | None:
    """Fit a family on top of a model, from `start` (k + p,) in SI. None if it cannot settle."""
    setup = smaller.forward.base
    limits = family.term(setup, start)
    for share in SHARES if family.effect.linear else (1.0,):
        at = start * np.where(np.arange(len(start)) < family.size, share, 1.0)
        term = family.term(setup, np.clip(at, limits.lower + 1e-9, limits.upper - 1e-9))
        forward = Forward(setup, [*smaller.forward.terms, term], smaller.point.solution)
        begin = np.concatenate([_revived(smaller), np.zeros(term.size)])
        first = settled(forward, begin)
        if first.solution.converged.all():
            break
    else:
        return None
    if _distorted(smaller):
        begin[: -term.size] = _beside(smaller, first.seen)
    slow = isinstance(family.effect, SLOW)
    if slow and np.allclose(first.seen, smaller.point.seen, rtol=0, atol=UNMOVED, equal_nan=True):
        return None  # nothing is touched: there nothing says where to go
    found = attempted(forward, data, noise, bins, begin, SOON if slow else 25, tolerance=1e-5)
    if slow and found is not None and found.cost < smaller.cost:
        found = _gone_on(smaller.cost, found, data, noise, bins)
    if found is None or not np.isfinite(found.cost) or not found.point.solution.converged.all():
        return None
    if len(found.z) != len(smaller.z):  # a frame did not settle at the start: nothing to compare
        return None
    return weighed(family, term, smaller, found)


def _gone_on(before: float, found: Fit, data: Data, noise: Noise, bins: int) -> Fit:
    """A fit of contact for as long as it gains: it flickers, and soon there is less to gain."""
    for _ in range(ROUNDS):
        if found.converged:
            break
        again = attempted(found.forward, data, noise, bins, found.point.u, SOON, tolerance=1e-4)
        worth = max(WORTH, SHARE * (before - found.cost))
        if again is None or again.cost > found.cost - worth:
            break
        found = again
    return found


def weighed(family: Family, term: Term, smaller: Fit, found: Fit) -> Rival:
    """A family that was fitted, its term the last one, against the smaller model."""
    spread = max(1.0, found.scale**2)
    evidence = 0.5 * (smaller.cost - found.cost) / spread - _flexibility(found, term)
    along = touches(found)
    gains = block_losses(smaller, along) - block_losses(found, along)
    return Rival(family, term, found, float(evidence), gains / spread)


def _revived(smaller: Fit) -> np.ndarray:
    """(P,) where a model with more to it begins: at the smaller one's values, but positive
    parameters that were driven to where nothing shows them any more begin anew; without a slope
    they would stay there for ever. (What a rope lacks in length makes it as soft as can be.)"""
    u, terms = smaller.point.u.copy(), smaller.forward.terms
    logs = np.repeat([t.log for t in terms], [t.size for t in terms])
    unseen = np.linalg.norm(smaller.jacobian, axis=0) < UNSEEN
    u[logs & unseen & ~np.isfinite(smaller.prior)] = 0.0
    return u


def _distorted(smaller: Fit) -> bool:
    """Whether a calibration error is where none can be: it stands for what the model lacks."""
    held = np.isfinite(smaller.prior)
    return bool((np.abs(smaller.point.u[held]) > FAR_OFF * smaller.prior[held]).any())


def _beside(smaller: Fit, seen: np.ndarray) -> np.ndarray:
    """(P,) the best values of the smaller model to first order, where something further makes its
    rope `seen` (F, K, 3): they need not stand for that any more."""
    s, u = smaller.stations, smaller.point.u
    moved = sensitivity((seen - smaller.point.seen)[None], s, s, smaller.whitener)[:, 0]
    project = Projection(smaller)
    held = np.isfinite(smaller.prior)
    pull = np.where(held, u / smaller.prior**2, 0.0)
    step = project.inverse @ (project.jacobian.T @ (smaller.z - moved) - pull)
    low, high = smaller.forward.bounds()
    return np.clip(u + step, low, high)


def _flexibility(found: Fit, term: Term) -> float:
    """Half the log of how much narrower the effect's values became, from broad priors."""
    k = term.size
    held = np.isfinite(found.prior)
    information = found.jacobian.T @ found.jacobian + np.diag(
        np.where(held, 1 / found.prior**2, 1e-12)
    )
    others = information[:-k, :-k]
    cross = information[:-k, -k:]
    own = information[-k:, -k:] - cross.T @ np.linalg.pinv(others, hermitian=True) @ cross
    length = float(found.forward.base.properties.length.sum())
    prior = np.array(
        [
            ANYWHERE * length / s if name in ("arc_length", "centre", "width") else BROAD
            for name, s in zip(term.names, term.scale, strict=True)
        ]
    )
    strength = np.linalg.eigvalsh(own * np.outer(prior, prior))
    return 0.5 * float(np.log1p(np.maximum(strength, 0.0)).sum())


def touches(found: Fit) -> bool:
    """Whether a model has contact in it. That may act in two frames next to each other, of which
    neither tells what the other would look like: there stretches of the rope are held out, no
    frames."""
    names = {effect.name for effect in CONTACT}
    return any(term.name in names for term in found.forward.terms)


def block_of_rows(found: Fit, along: bool) -> np.ndarray:
    """(M D,) the block of each whitened row: of neighbouring frames, or of every fifth station
    along the rope."""
    s, frames = found.stations, len(found.point.seen)
    block = s.bin % BLOCKS if along else (np.arange(frames) * BLOCKS // frames)[s.frame]
    return np.repeat(block, s.residual.shape[1])


def predicted(found: Fit, along: bool = False) -> np.ndarray:
    """(M D,) whitened residual of each block as predicted by a fit to the others.

    First order around the fit of all: z_b + J_b (H - J_bᵀJ_b)⁻¹ J_bᵀ z_b.
    """
    held = np.isfinite(found.prior)
    whole = found.jacobian.T @ found.jacobian + np.diag(np.where(held, 1 / found.prior**2, 0.0))
    block, out = block_of_rows(found, along), np.empty_like(found.z)
    for b in range(BLOCKS):
        mine = block == b
        j, z = found.jacobian[mine], found.z[mine]
        rest = np.linalg.pinv(whole - j.T @ j, rcond=1e-12, hermitian=True)
        out[mine] = z + j @ (rest @ (j.T @ z))
    return out


def block_losses(found: Fit, along: bool) -> np.ndarray:
    """(BLOCKS,) half the squared predicted residual of each block."""
    z, block = predicted(found, along), block_of_rows(found, along)
    return np.array([0.5 * float(z[block == b] @ z[block == b]) for b in range(BLOCKS)])


def heldout_rms(found: Fit, along: bool = False) -> tuple[float, float]:
    """Predicted rms distance of the points from the model, and the noise of a point [m].

    What stations scatter by themselves is noise and not counted twice.
    """
    s = found.stations
    residual = found.whitener.undo(predicted(found, along)).reshape(s.residual.shape)
    white = s.scatter.mean(axis=0)
    if not white.any():  # markers: their noise is in the whitener
        noise = float(np.sqrt(found.whitener.variance() * 3))
        return float(np.sqrt((residual**2).sum(axis=1).mean())), noise
    weight = s.count[:, None] / s.count.sum()  # by points, as if each were compared by itself
    extra = (weight * (residual**2 - np.diagonal(s.white(), axis1=1, axis2=2))).sum(axis=0)
    noise = float(np.sqrt(white.sum()))
    return float(np.sqrt(max(white.sum() + extra.sum(), 0.0))), noise
