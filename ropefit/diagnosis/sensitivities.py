"""Whitened sensitivities of all stations to every effect at every place, without refit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch

from ropefit.diagnosis.hypotheses import Hypothesis
from ropefit.inference.bins import aligned
from ropefit.inference.least_squares import Fit
from ropefit.models.response import Point
from ropefit.models.terms import change_by
from ropefit.solvers.equilibrium.implicit import Directions, tangent

NEAR = 1e-3  # of the length: shapes that differ by less answer alike
NEAR_IN_MOTION = 0.1  # of what is missed, rms: the same of motions
STRAIGHT = 1e-9  # of the rest vectors of bend elements
AT_ONCE = 16  # changes of a rope at rest: each has a rod for every frame
PROBE = 0.3  # of its usual size: where an effect is tried that has no derivative at zero


@dataclass(frozen=True)
class Sensitivity:
    """Of one hypothesis: values (M D, Q, k), changes per usual size of each quantity, and those
    that they come from, of a rope `seen` (F, K, 3) [m]: moved (Q k, F, K, 3) [m] of the nodes, or
    (M, D, Q k) of the stations in a motion, of which all frames of all clips are too many, and of
    markers, whose places along the rope are known."""

    hypothesis: Hypothesis
    values: np.ndarray
    moved: np.ndarray
    seen: np.ndarray


class Sensitivities:
    """Compute sensitivities at a fit's point; what they share is computed once."""

    def __init__(self, fit: Fit) -> None:
        self.fit, self.point = fit, fit.point
        self.now = fit.problem.match(np.where(np.isfinite(fit.point.seen), fit.point.seen, 0.0))
        self.setup = fit.point.setup
        self.earlier: tuple[np.ndarray, np.ndarray] | None = None

    def of(self, hypothesis: Hypothesis, known: Sensitivity | None = None) -> Sensitivity:
        """Return the sensitivity to a hypothesis: by its loads, its tangent or finite responses, or
        from one that is known of a rope in nearly the same shapes."""
        seen = self.point.seen
        placed = self.fit.problem.data.material or not self.fit.forward.instantaneous
        if known is not None and self._alike(hypothesis, known):
            moved, seen = known.moved, known.seen
        else:
            moved = np.nan_to_num(self._nodes(hypothesis), copy=False)
            moved = self._at_stations(moved) if placed else moved
        rows = self.fit.whitener(moved if placed else self._at_stations(moved))
        shape = (len(rows), len(hypothesis.places), hypothesis.size)
        return Sensitivity(hypothesis, rows.reshape(shape), moved, seen)

    def _at_stations(self, dx: np.ndarray) -> np.ndarray:
        """Return (M, D, P) [m] what changes dx (P, F, K, 3) [m] of the nodes change there."""
        return aligned(self.now, self.fit.stations, self.now.project(dx))

    def _alike(self, hypothesis: Hypothesis, known: Sensitivity) -> bool:
        """Return whether the rope responds as it is known to."""
        places, seen = known.hypothesis.places, known.seen
        if places.shape != hypothesis.places.shape or seen.shape != self.point.seen.shape:
            return False
        length = float(self.setup.properties.length.sum())
        if (np.abs(places - hypothesis.places) >= NEAR * length).any():
            return False
        if self.fit.forward.instantaneous:
            return bool((np.abs(seen - self.point.seen) < NEAR * length).all())
        stations = self.fit.stations
        if self.earlier is None or self.earlier[0] is not seen:  # a scan shares one
            self.earlier = seen, self.fit.problem.match(np.nan_to_num(seen)).residual
        apart = self.earlier[1] - self.now.residual
        missed = np.linalg.norm(stations.residual)
        same = apart.shape == stations.residual.shape == known.moved.shape[:2]
        return same and bool(np.linalg.norm(apart) < NEAR_IN_MOTION * missed)

    def _nodes(self, hypothesis: Hypothesis) -> np.ndarray:
        loads = self._loads(hypothesis) if self.fit.forward.instantaneous else None
        if loads is not None:
            return loads_to_nodes(self.point, loads)
        if hypothesis.effect.turns_rope and self._spins_freely():
            return self._tangents(hypothesis, turned=True)
        if hypothesis.effect.tangent:
            return self._tangents(hypothesis)
        return self._finite_responses(hypothesis)

    def _spins_freely(self) -> bool:
        """Return whether the rope may spin at no cost: it is straight without loads, and has no
        memory."""
        setup, rod = self.setup, self.point.solution.rod
        straight = float(rod.rest.abs().max()) < STRAIGHT
        return self.fit.forward.instantaneous and not setup.remembers and straight

    def _tangents(self, hypothesis: Hypothesis, turned: bool = False) -> np.ndarray:
        zero = np.zeros(hypothesis.size)
        terms = [
            hypothesis.term_at(self.setup, np.concatenate([zero, place]))
            for place in hypothesis.places
        ]
        if hypothesis.effect.path_dependent:
            start = np.zeros(sum(term.size for term in terms))
            model = self.fit.forward.of_setup(self.setup, self.point.solution, terms)
            return model.jacobian(model.at(start))
        changes = [change_by(self.setup, term, k) for term in terms for k in range(term.size)]
        if not self.fit.forward.instantaneous or self.setup.remembers or not changes:
            return self.point.respond(changes)
        more = {"turned": True} if turned else {}
        parts = [changes[k : k + AT_ONCE] for k in range(0, len(changes), AT_ONCE)]
        return np.concatenate([self.point.respond(part, **more) for part in parts])

    def _finite_responses(self, hypothesis: Hypothesis) -> np.ndarray:
        scales, out = hypothesis.scales(self.setup), []
        for place in hypothesis.places:
            for k in range(hypothesis.size):
                values = np.zeros(hypothesis.size)
                values[k] = PROBE * scales[k]
                changed = self.response(hypothesis, np.concatenate([values, place]))
                out.append((changed - self.point.seen) / PROBE)
        return np.stack(out)

    def response(self, hypothesis: Hypothesis, values: np.ndarray) -> np.ndarray:
        """Return (F, K, 3) nodes as seen with the effect at values (k + p,), NaN if unsettled."""
        setup = self.setup.after(lambda s: hypothesis.effect.apply(s, torch.from_numpy(values)))
        return self.fit.forward.of_setup(setup, self.point.solution).at(np.empty(0)).seen

    def _loads(self, hypothesis: Hypothesis) -> np.ndarray | None:
        """Return (F, Q k, K, 3) [N] on the nodes per usual size, where an effect is such a load."""
        x, out = self.point.solution.x, []
        for place in hypothesis.places:
            loads = hypothesis.effect.unit_loads(self.setup, x, place)
            if loads is None:
                return None
            out.append(loads)
        scales = hypothesis.scales(self.setup)[:, None, None]
        return (np.stack(out, axis=1) * scales).reshape(len(x), -1, x.shape[1], 3)


def loads_to_nodes(point: Point, load: np.ndarray) -> np.ndarray:
    """Return (P, F, K, 3) [m] changes of the nodes for loads (F, P, K, 3) [N] on them."""
    dx, _ = tangent(point.solution, Directions(load=load))
    return np.moveaxis(dx, 1, 0)
