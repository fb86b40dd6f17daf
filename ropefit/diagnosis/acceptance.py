"""Acceptance: a candidate must be plausible and significant, and held-out data must support it."""

from __future__ import annotations

import numpy as np

from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.equivalence import TIE_NATS
from ropefit.diagnosis.held_out import by_stretches, firm_rows, heldout_rms, weighted_error
from ropefit.diagnosis.innovations import contradicted
from ropefit.diagnosis.wander import MESH_ERROR
from ropefit.effects.base import Effect
from ropefit.inference.least_squares import Fit
from ropefit.inference.verdict import NORMAL_QUANTILE

LEAST_SIGNIFICANCE = NORMAL_QUANTILE  # standard errors from zero: 95 %
MOST_RMS_RATIO = 1.01  # of the held-out rms, over that without the candidate
# The same of a motion: a coarse mesh and a wrong first state miss as much as small effects explain.
MOST_RMS_RATIO_IN_MOTION = 0.85
AT_LIMIT = 0.01  # of the range of a quantity, in SI: fits end a little short of it
BEYOND_SENSOR = 3.0  # times what markers and mesh explain
CHANCE_GAIN = 1.0  # nats that a held-out block may gain by chance
LEAST_BLOCKS = 2  # that gain more than that
LOST_SHARE = 0.3  # of what blocks gain, at most lost by the others


def first_acceptable(
    candidates: list[Candidate], threshold: float, current: Fit, refused: list[str]
) -> Candidate | None:
    """Return the first candidate that passes every gate; reasons of the others go to `refused`.

    candidates: highest evidence first; current: the model without any of them. A force that can
    stand for much else is not accepted where another effect explains more, but only with a size
    that is not plausible: neither is what is there.
    """
    better: Candidate | None = None  # the first one that is not plausible
    for candidate in candidates:
        if candidate.evidence < threshold:
            return None
        why = refusal(candidate, current)
        general = candidate.hypothesis.effect.stands_for_others and not why
        if better and general and better.evidence - candidate.evidence > TIE_NATS:
            why = f"{better.hypothesis.name} explains more, but only if implausibly large"
        if not why:
            return candidate
        refused.append(f"{candidate.hypothesis.name}: {why}")
        if better is None and not candidate.plausible():
            better = candidate
    return None


def refusal(candidate: Candidate, current: Fit) -> str:
    """Return why a candidate is not accepted; empty if it is."""
    why = not_possible(candidate, current)
    if not why and not significant(candidate):
        return "its size is not significantly different from zero"
    return why or _not_supported(candidate, current)


def ruled_out(candidate: Candidate, current: Fit) -> bool:
    """Return whether a candidate with much evidence is not what is there: it is not possible, or
    not supported by held-out data. How well its own size is known does not matter."""
    return bool(not_possible(candidate, current) or _not_supported(candidate, current))


def not_possible(candidate: Candidate, current: Fit) -> str:
    """Return why a candidate's values cannot be; empty if they can."""
    if not candidate.plausible():
        return "larger than anything plausible"
    if candidate.hypothesis.effect.law(current.point.setup) is not None and at_most(candidate):
        return "it fits only where its form runs to a bound"
    return ""


def _not_supported(candidate: Candidate, current: Fit) -> str:
    """Return why held-out data do not support a candidate; empty if they do."""
    effect, moving = candidate.hypothesis.effect, not current.forward.instantaneous
    along, firm = by_stretches(candidate.fit), firm_rows(current, candidate.fit)
    before, after = (_error(fit, along, firm) for fit in (current, candidate.fit))
    # A calibration error far outside its prior explains held-out frames as well as the effect of
    # the same kind does: there the evidence is in the prior.
    alike = not moving and candidate.fit.problem.noise.repeats > 1
    supported = effect.prior_decides or agreeing(candidate.gains, alike)
    if after > MOST_RMS_RATIO * before or not supported:
        return "held-out frames do not support it"
    little = moving and after > MOST_RMS_RATIO_IN_MOTION * before
    if little and not (_allowed_for(effect, current) or _large(candidate, current, after / before)):
        return "the error of held-out clips falls by too little"
    if contradicted(candidate.fit, current):
        return "short predictions contradict it"
    return ""


def significant(candidate: Candidate) -> bool:
    """Return whether a candidate's size is significantly different from zero."""
    return candidate.significance() >= LEAST_SIGNIFICANCE


def at_most(candidate: Candidate) -> bool:
    """Return whether a quantity is as large as it may be: of either sign, if that is a direction.

    Least values are forms, too: an exponent that is nearly zero is that of a plateau.
    """
    effect, setup = candidate.hypothesis.effect, candidate.fit.point.setup
    low, high = (np.array(bound) for bound in effect.bounds(setup))
    directed = np.array([q.unit != "1" for q in effect.quantities]) & (low == -high)
    values = candidate.values()[: len(low)]
    values = np.where(directed, np.abs(values), values)
    limited = np.isfinite(low) & np.isfinite(high)
    limited &= [not q.open_ended for q in effect.quantities]
    low, high, values = low[limited], high[limited], values[limited]
    return bool((values > high - AT_LIMIT * (high - low)).any())


def far_beyond_sensor(fitted: Fit) -> bool:
    """Return whether a motion is missed by far more than markers and mesh explain."""
    sensor = fitted.problem.noise.sensor
    if fitted.forward.instantaneous or not sensor:
        return False
    missed = float(np.sqrt((fitted.stations.residual**2).mean()))
    return missed > BEYOND_SENSOR * _markers_and_mesh(fitted)


def _markers_and_mesh(fitted: Fit) -> float:
    """Return what markers and mesh explain of what a motion is missed by, rms [m]."""
    length = float(fitted.point.setup.properties.length.sum())
    return float(np.hypot(fitted.problem.noise.sensor, MESH_ERROR * length))


def _large(candidate: Candidate, current: Fit, ratio: float) -> bool:
    """Return whether a candidate that lowers the error of held-out clips by some ratio explains far
    more of them than markers and mesh do, though little of all that is missed.

    Folds gain more than chance on average, not each: one of few independent samples loses by chance
    what the effect gains it. The noise of a motion is what a typical clip is missed by.
    """
    if not far_beyond_sensor(current) or not candidate.gains.mean() > CHANCE_GAIN:
        return False
    explained = current.problem.noise.marker * float(np.sqrt(max(1 - ratio**2, 0.0)))
    return explained > BEYOND_SENSOR * _markers_and_mesh(current)


def _error(fitted: Fit, along: bool, rows: np.ndarray) -> float:
    """Return the rms error of held-out data [m] in some rows (M D,); of a motion in units of its
    noise, as a clip that no prediction keeps in step with misses by more than all others."""
    instantaneous = fitted.forward.instantaneous
    return heldout_rms(fitted, along, rows)[0] if instantaneous else weighted_error(fitted, along)


def _allowed_for(effect: Effect, fitted: Fit) -> bool:
    """Return whether a fit has an effect's small sizes already, as an error of the set-up."""
    if effect.calibrated or effect.calibration is None:
        return effect.calibrated
    return any(term.nuisance and term.name == effect.error_name for term in fitted.forward.terms)


def agreeing(gains: np.ndarray, alike: bool = False) -> bool:
    """Return whether held-out blocks support an effect, by their gains [nats].

    More than one gains, and the others lose little against that. A rope may touch a plane in few
    frames: the others neither gain nor lose; a barely visible effect gains and loses by chance.
    alike: of a rope that is known from another recording and missed alike in neighbouring frames, a
    block has few independent samples: two that gain half as much each are enough, if all gain as
    much together.
    """
    lost, gained = -gains[gains < 0].sum(), gains[gains > 0].sum()
    least = CHANCE_GAIN / 2 if alike else CHANCE_GAIN
    several = (gains > least).sum() >= LEAST_BLOCKS and gained > LEAST_BLOCKS * CHANCE_GAIN
    return bool(several and lost <= LOST_SHARE * gained)
