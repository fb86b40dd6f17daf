"""identify --law: a function that is fitted as a curve, beside the rope's parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.causes import effect_of
from ropefit.adapters.diagnosis_content import sizes_of
from ropefit.adapters.law_content import law_of
from ropefit.adapters.rope_setup import STATIONS
from ropefit.artifacts import FittedModel, Observations
from ropefit.artifacts.causes import Cause
from ropefit.diagnosis.accepted import LEAST_P
from ropefit.diagnosis.candidate import Candidate, fit_candidate
from ropefit.diagnosis.forms import INSIDE
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.effects import Effect
from ropefit.errors import BadInput, NotConverged, WrongUsage
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise, estimate
from ropefit.models.terms import Term
from ropefit.plugins import EFFECTS, concrete
from ropefit.rod.setup import Setup

LEAST_RANGE = 2.0  # of the variable, largest over smallest: less shows one value of the curve
EVALUATIONS = 30


def law_named(name: str) -> Effect:
    """Return the effect whose law is asked for by a name. Raises WrongUsage."""
    every = {e.asked_as: e for e in concrete(Effect, EFFECTS) if e.asked_as}
    if name not in every:
        raise WrongUsage(f"--law {name}: unknown; one of {', '.join(sorted(every))}")
    return every[name]()  # pyright: ignore[reportAbstractUsage]


def with_law(linear: Fit, effect: Effect) -> Candidate:
    """Return a law fitted beside the linear rope, both under the noise that is left beside it.

    Raises BadInput where the data visit no range of its variable; NotConverged.
    """
    setup = linear.point.setup
    hypothesis = Hypothesis(effect, NO_PLACE)
    _check_range(effect, linear)
    first = fit_candidate(linear, hypothesis, np.zeros(len(effect.names)))
    if first is None:
        raise NotConverged(f"no frame settles under a law: {effect.name}")
    # Short stations: within a long one a strongly bent rope is not one place.
    seen = first.fit.point.seen
    problem = replace(linear.problem, bins=STATIONS).settled(seen)
    stations, own = problem.match(seen), problem.noise.marker
    white = None if problem.data.material else tuple(float(v) for v in stations.scatter[0])
    known = Noise(marker=own * max(1.0, first.fit.scale), white=white)
    noise = estimate(stations, known)
    again = fit(linear.forward, problem.under(noise), linear.point.u, EVALUATIONS)
    found = fit_candidate(again, hypothesis, _inside(effect, setup, first.values()))
    if found is None:
        raise NotConverged(f"no frame settles under a law: {effect.name}")
    return found


def law_cause(o: Observations, law: Candidate) -> Cause:
    """Return what is known of a law that was asked for."""
    effect, values = law.hypothesis.effect, law.values()
    content = law_of(o, law, law.fit)
    assert content is not None
    return Cause(
        name=effect.name,
        kind=effect.kind,
        variant=type(effect).__name__,
        arc_length=(0.0, o.length),
        frames=o.frames,
        parameters=sizes_of(law, values, law.sd()),
        values=values,
        value_names=list(effect.names),
        covariance=law.covariance_of_values(),
        equivalent_to=[],
        log_evidence=law.evidence,
        p_value=max(min(1.0, float(np.exp(-min(law.evidence, 690.0)))), LEAST_P),
        heldout_gain=law.gains,
        sentence=content[1],
        law=content[0],
    )


def own_laws(model: FittedModel, setup: Setup) -> list[tuple[str, Cause, Term]]:
    """Return the laws with which a rope was identified, each with its name and its term, which
    starts at its values there."""
    out = []
    for name, cause in model.laws.items():
        effect = effect_of(cause)
        term = Hypothesis(effect, NO_PLACE).term(setup, _inside(effect, setup, cause.values))
        out.append((f"known_{name}", cause, term))
    return out


def _inside(effect: Effect, setup: Setup, values: np.ndarray) -> np.ndarray:
    """Return values (n,) within the bounds: a search starts inside."""
    low, high = (np.array(bound) for bound in effect.bounds(setup))
    return np.clip(values, low + 1e-6, high - 1e-6)


def _check_range(effect: Effect, linear: Fit) -> None:
    law = effect.law(linear.point.setup)
    assert law is not None
    visited = law.visited(linear.point.setup, linear.point.solution.x)
    least, most = np.quantile(visited, INSIDE)
    if most < LEAST_RANGE * least:
        raise BadInput(
            f"--law: the {law.x} is about the same everywhere ({least:.3g} to {most:.3g} "
            f"{law.unit_x}), so that one value of the curve is all that shows; record poses with "
            "the ends close together and far apart, or leave out --law"
        )
