"""The fit of what was accepted: to the frames that count then, with the noise that is left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.diagnosis.accepted import Accepted
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.full_scan import Scan
from ropefit.diagnosis.hypotheses import made_possible
from ropefit.diagnosis.pairs import Pair, accepted_pair
from ropefit.diagnosis.quick_fits import unknown_frames
from ropefit.diagnosis.sensitivities import Sensitivity
from ropefit.diagnosis.unexplained import leaves_something
from ropefit.diagnosis.wander import (
    no_larger_than_left,
    wandering_noise,
    with_what_is_missed_alike,
)
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.problem import FitProblem

# Of a fit after the noise was measured again; few of frames that are settled one after the other,
# which take long, and are fitted once more at the end.
EVALUATIONS, FEW_EVALUATIONS = 25, 4
REMEASURED = 2  # times, the noise of a motion: a clip that was missed is so no longer


def with_both(current: Fit, every: Data, pair: Pair, scan: Scan) -> tuple[list[Accepted], Fit]:
    """Return two effects that were found at once as accepted, and the fit of them to the data of
    the frames that count."""
    accepted, found = accepted_pair(pair, len(scan.sensitivities))
    counts = current.problem.data.mask.any(axis=1, keepdims=True)
    data = replace(every, mask=every.mask & counts).settled(found.point.seen)
    return accepted, with_it(found, replace(current.problem, data=data), scan.sensitivities)


def with_known_past(data: Data, before: Fit, best: Candidate) -> Data:
    """Return the data without the frames in which the accepted effect acts by what was before the
    recording or, where something is left to be explained, those may that can occur only now, as
    friction on what is touched."""
    found = best.fit
    setup, x = found.point.setup, found.point.solution.x
    known = best.hypothesis.effect.path_dependent or not found.forward.instantaneous
    lost = np.zeros(len(x), dtype=bool) if known else unknown_frames(best)
    if leaves_something(found):
        for effect in made_possible(setup, before.point.setup):
            lost |= effect.begun_before(setup, x)
    return replace(data, mask=data.mask & ~lost[:, None])


def with_it(found: Fit, problem: FitProblem, sensitivities: list[Sensitivity]) -> Fit:
    """Return the fit of an accepted effect to all data, with the noise that is left then."""
    forward = found.forward.starting_from(found.point.solution)
    if found.forward.instantaneous:
        noise = no_larger_than_left(problem.noise, found, [])
        problem = problem.under(with_what_is_missed_alike(noise, found, []))
        most = FEW_EVALUATIONS if found.point.setup.remembers else EVALUATIONS
        return fit(forward, problem, found.point.u, most, tolerance=1e-5)
    known = replace(problem, data=found.problem.data)  # at its stations are the sensitivities
    for _ in range(REMEASURED):  # less is left, and what is left wanders less
        known = known.under(wandering_noise(found, sensitivities))
        forward = forward.corrected(found.point.u)
        found = fit(forward, known, found.point.u, EVALUATIONS, tolerance=1e-5)
    if problem.data.material:
        return found
    return fit(forward, problem.under(known.noise), found.point.u, EVALUATIONS, tolerance=1e-5)
