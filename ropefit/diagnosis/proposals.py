"""Starts of full fits that effects propose themselves, from what a fit leaves.

A scan looks at small changes of a fit. What has no small beginnings (contact), or hides in a fit
that has gone astray (inertia), says by itself where it may be.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ropefit.diagnosis.calm import calm, excess, pushes
from ropefit.diagnosis.forces_on_nodes import ForcesOnNodes
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis, effects_of
from ropefit.effects import Effect
from ropefit.effects.misfit import Misfit
from ropefit.inference.least_squares import Fit, inside

UNEVEN_SD = 5.0  # standard errors by which one frame must be worse than the median one

# A hypothesis with the values (SI) from which its fit starts.
Start = tuple[Hypothesis, np.ndarray]


def proposals(current: Fit, slow: bool, names: tuple[str, ...] | None = None) -> list[list[Start]]:
    """Return starts, each with alternatives in case it does not settle, of effects whose fits are
    slow or late, or of the others; names: only of these effects."""
    every = effects_of(current.point.setup, names)
    effects = [e for e in every if (e.slow or e.late) == slow]
    if not effects:
        return []
    in_some = any(effect.slow and not effect.path_dependent for effect in effects)
    misfit = misfit_of(calm(current) if in_some else current)
    found = [(effect, choices) for effect in effects for choices in effect.starts(misfit)]
    found += [(e, [v]) for e in effects if (v := _error_at_bound(current, e)) is not None]
    return [
        [(Hypothesis(effect, NO_PLACE), values) for values in choices] for effect, choices in found
    ]


def _error_at_bound(current: Fit, effect: Effect) -> np.ndarray | None:
    """Return the values (n,) of an effect that the model has as an error of the set-up, where that
    is at a bound, far outside its prior: a scan, which holds it there, does not see the effect."""
    if not effect.error_name:
        return None
    forward, u = current.forward, current.point.u
    parts = zip(forward.terms, forward.split(u), forward.split(inside(current)), strict=True)
    return next(
        (
            term.value(part)
            for term, part, free in parts
            if term.nuisance and term.name == effect.error_name and not free.all()
        ),
        None,
    )


def proposals_beside(
    leader: Effect, values: np.ndarray, fitted: Fit, names: tuple[str, ...] | None = None
) -> list[list[Start]]:
    """Return starts of effects that may fit as well as `leader`, fitted with values (n,), does: its
    own, where that leaves other minima."""
    misfit = misfit_of(fitted)
    return [
        [(Hypothesis(effect, NO_PLACE), at) for at in choices]
        for effect in effects_of(misfit.setup, names)
        for choices in effect.starts_beside(leader, values, misfit)
    ]


def misfit_of(fitted: Fit) -> Misfit:
    """Return what a fit leaves, as effects see it."""
    s, point, data = fitted.stations, fitted.point, fitted.problem.data

    @cache
    def forces(on: tuple[int, ...]) -> ForcesOnNodes:
        return ForcesOnNodes(fitted, on)

    nodes = np.where(np.isnan(point.seen), np.nan, point.solution.x)
    return Misfit(
        setup=point.setup,
        stated=fitted.forward.base,
        points=data.points,
        counts=data.mask & data.depth,
        nodes=nodes,
        frame=s.frame,
        places=s.places(nodes),
        moves=s.offset,
        variance=float(np.trace(s.white().mean(axis=0))) if len(s.frame) else 0.0,
        excess=excess(fitted),
        terms=frozenset(term.name for term in fitted.forward.terms),
        pushes=lambda: pushes(fitted),
        forces=forces,
    )


def uneven(fitted: Fit) -> bool:
    """Return whether some frames are left far worse than the median one."""
    return bool((excess(fitted) > UNEVEN_SD).any())
