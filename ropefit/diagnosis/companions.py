"""Two effects at once, of which one can occur only beside the other: what is touched may be rough.

A rope on a rough table is far from where it would lie on a smooth one, where it may not even come
to rest. By itself, as a first effect is fitted, such a table explains nothing, and friction would
never be tried beside it. Both are fitted at once, from where the first is proposed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ropefit.diagnosis.acceptance import refusal
from ropefit.diagnosis.beginning import Beginning, settled_start
from ropefit.diagnosis.calm import calm
from ropefit.diagnosis.candidate import (
    SLOW_COST,
    SLOW_EVALUATIONS,
    Candidate,
    comparable,
    compared,
    continued,
)
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis, made_possible
from ropefit.diagnosis.pairs import Pair
from ropefit.diagnosis.proposals import Start, misfit_of
from ropefit.diagnosis.unexplained import explained, unexplained
from ropefit.effects.base import MAY_LEAVE
from ropefit.effects.misfit import Misfit
from ropefit.inference.known import settled
from ropefit.inference.least_squares import Fit, attempted
from ropefit.rod.potential import Potential

EVALUATIONS = 20  # of a fit of the model without either
# Of the frames, in which the data lie on a body, by so many sd of the noise: where they do in few,
# the body is found alone, and what it makes possible beside it.
LEAST_LYING, NOISE_SD = 0.25, 2.0


class Companions(NamedTuple):
    """Two hypotheses that explain nearly all of what a smaller model leaves, the second possible
    only beside the first: `smaller`, fitted without the frames in which they would act by what was
    before the recording, and the fit with both, its last terms theirs."""

    hypotheses: list[Hypothesis]
    smaller: Fit
    fit: Fit


def companions(
    current: Fit, proposed: list[list[Start]], names: tuple[str, ...] | None = None
) -> Companions | None:
    """Return one of the `proposed` effects with one that it makes possible, fitted, from the most
    promising beginning that leads there; None unless they leave next to nothing."""
    begun: list[tuple[float, list[Start], Fit, Beginning]] = []
    for starts in _pairs(current, proposed, names):
        smaller = _with_known_beginning(current, starts)
        begin = None if smaller is None else settled_start(smaller, starts)
        if smaller is None or begin is None:
            continue
        share = begin.misfit / float(smaller.z @ smaller.z)
        if share < 1.0:
            begun.append((share, starts, smaller, begin))
        if share < MAY_LEAVE:  # as it begins: walks are slow
            break
    # How a rope is dragged jumps with where the body is: the best beginning may lead nowhere.
    for _, starts, smaller, begin in sorted(begun, key=lambda one: one[0]):
        fitted = _fitted(smaller, begin)
        if fitted is not None:
            return Companions([h for h, _ in starts], smaller, fitted)
    return None


def _pairs(
    current: Fit, proposed: list[list[Start]], names: tuple[str, ...] | None
) -> Iterator[list[Start]]:
    """Yield where the fits of two effects begin, the second possible only beside the first."""
    origin = calm(current)
    setup, misfit = origin.point.setup, misfit_of(origin)
    for hypothesis, values in (choices[0] for choices in proposed):
        changed = setup.after(lambda s, h=hypothesis, at=values: h.effect.apply(s, at))
        if _lying(misfit, changed.potentials[len(setup.potentials) :]) < LEAST_LYING:
            continue
        for effect in made_possible(changed, setup, names):
            for others in effect.starts(replace(misfit, setup=changed)):
                yield [(hypothesis, values), (Hypothesis(effect, NO_PLACE), others[0])]


def _lying(misfit: Misfit, bodies: tuple[Potential, ...]) -> float:
    """Return the share of the frames whose data lie on one of some bodies, by their noise."""
    data = misfit.places + misfit.moves - NOISE_SD * np.sqrt(misfit.variance) * misfit.setup.up
    lies = [p.energy(data) > 0 for p in bodies]
    return len(np.unique(misfit.frame[np.any(lies, axis=0)])) / len(misfit.nodes) if lies else 1.0


def _with_known_beginning(current: Fit, starts: list[Start]) -> Fit | None:
    """Return the model as fitted without the frames in which effects that start so would act by
    what was before the recording; None where these do not settle."""
    origin = calm(current)
    setup = origin.forward.base
    terms = [hypothesis.term(setup, values) for hypothesis, values in starts]
    model = origin.forward.with_terms([*origin.forward.terms, *terms], origin.point.solution)
    point = settled(model, np.concatenate([origin.point.u, *(np.zeros(t.size) for t in terms)]))
    if not (point.converged.all() and point.setup.possible):
        return None
    lost = np.zeros(len(point.seen), dtype=bool)
    for hypothesis, _ in starts:
        lost |= hypothesis.effect.begun_before(point.setup, point.solution.x)
    if not lost.any():
        return current
    problem, forward = current.problem.without(lost), current.forward
    forward = forward.starting_from(current.point.solution)
    return attempted(forward, problem, current.point.u, EVALUATIONS, tolerance=1e-5)


def _fitted(smaller: Fit, begun: Beginning) -> Fit | None:
    """Return the fit of both, if it leaves next to nothing."""
    most = len(smaller.z) + MAY_LEAVE * max(unexplained(smaller), 0.0)
    found = attempted(
        begun.forward, smaller.problem, begun.values, SLOW_EVALUATIONS, tolerance=1e-5,
        needed=most, matched=False,
    )  # fmt: skip
    if found is None or found.stopped or found.cost > smaller.cost:
        return None
    found = continued(smaller.cost, found, most, as_matched=False)  # is fitted again
    return found if comparable(found, smaller) and explained(smaller, found) else None


def accepted_companions(current: Fit, known: Companions, threshold: float) -> Pair | None:
    """Return both as fitted on top of the current model, each with the model without it, and the
    fit with both; None unless they leave next to nothing and both pass every gate."""
    model, u = known.fit.forward.starting_from(known.fit.point.solution), known.fit.point.u
    whole = attempted(model, current.problem, u, SLOW_EVALUATIONS, tolerance=1e-5, matched=False)
    if whole is None or whole.cost > current.cost:
        return None
    whole = continued(current.cost, whole, whole.cost - SLOW_COST)  # it began near its end
    if not comparable(whole, current) or not explained(current, whole):
        return None
    first, second = whole.forward.terms[-2:]
    alone = whole.forward.with_terms(whole.forward.terms[:-1], current.point.solution)
    begin = whole.point.u[: alone.size]
    beside = attempted(alone, current.problem, begin, EVALUATIONS, tolerance=1e-4)
    if beside is None or not comparable(beside, current) or beside.cost > current.cost:
        beside = current  # without the second, the first does not come to rest or explains nothing
    pair: list[tuple[Candidate, Fit]] = [
        (compared(known.hypotheses[0], first, current, whole), current),
        (compared(known.hypotheses[1], second, beside, whole), beside),
    ]
    if any(c.evidence < threshold or refusal(c, without) for c, without in pair):
        return None
    return pair, whole
