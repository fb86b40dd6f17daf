"""What another recording says of the same rope and its markers: taken over by `--nominal`."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ropefit.adapters.causes import effect_of
from ropefit.adapters.equilibrium_model import calibration_name
from ropefit.adapters.frozen import PER_WEIGHT, weight_factor
from ropefit.artifacts import Diagnosis, Model, Observations
from ropefit.artifacts.causes import Cause
from ropefit.models.correlated import correlated
from ropefit.models.priors import DEGREE, Priors
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup

TakenOver = tuple[str, Cause, Term]  # a name for it, the cause there, and the term here
LEAST_SD = 1e-3  # of the usual size, or of the length: however well another run knows a value
MOST_LEFT = 3.0  # times the noise of a point: what leaves more at rest is not the whole cause
WIDEST = {"width": 2.0}  # of the length: a stretch may begin at the rope's end
MOST_OF_SQUARE = 0.5  # of the mean square of what is missed: what leaves more stands for another


def understood(model: Model, found: Diagnosis) -> bool:
    """Return whether what a run at rest found may be taken over: it leaves little more than noise,
    or all of it belongs to the rope and explains most of what was missed.

    What acts on the rope and leaves much stands for something else, which may be the rope's own,
    and the rope's values were fitted beside it: without it, in another recording, they are wrong.
    So are those of the rope that explain little: a law in the place of another.
    """
    if model.nominal.balance is None:
        return True
    of_the_rope = all(effect_of(cause).of_rope for cause in found.causes.values())
    most = found.rms_after**2 <= MOST_OF_SQUARE * found.rms_before**2
    return found.rms_after <= MOST_LEFT * noise_there(found) or (of_the_rope and most)


def noise_there(found: Diagnosis) -> float:
    """Return the noise of a point [m] in a nominal run, at most what neighbouring poses tell: what
    is missed there may have been taken for noise."""
    return min(found.noise_white, found.noise_repeated or np.inf)


def as_found(model: Model, found: Diagnosis) -> Model:
    """Return another run's model with the rope's own values as they were fitted along with what was
    found, and with what was then left."""
    fitted = model.nominal
    solved = fitted.balance or fitted.stepped
    if not found.causes or solved is None:
        return model
    name, group = next(iter(fitted.groups.items()))
    parameters = {
        key: p.model_copy(update={"value": found.rope[key].value, "ci95": found.rope[key].ci95})
        if key in found.rope
        else p
        for key, p in group.parameters.items()
    }
    stiffer = parameters["EI"].value / group.parameters["EI"].value
    longer = solved.bending_length * stiffer ** (1 / 3)
    changed = solved.model_copy(update={"bending_length": longer})
    groups = {name: group.model_copy(update={"parameters": parameters})}
    left = min(fitted.rms_fit, found.rms_after)
    where = "balance" if fitted.balance else "stepped"
    changed = {"groups": groups, where: changed, "rms_fit": left}
    models = model.models | {"nominal": fitted.model_copy(update=changed)}
    return model.model_copy(update={"models": models})


def over_mass(model: Model, there: Observations, here: Observations) -> Model:
    """Return a rope in motion, of unknown mass, with the ratios to the weight that it has under the
    gravity told here: a motion shows rigidities over the mass, whatever gravity is said to be."""
    fitted = model.nominal
    if fitted.stepped is None or there.mass or here.mass:
        return model
    factor = float(np.linalg.norm(there.gravity) / np.linalg.norm(here.gravity))
    name, group = next(iter(fitted.groups.items()))
    parameters = {
        key: p.model_copy(
            update={"value": factor * p.value, "ci95": p.ci95 and tuple(factor * v for v in p.ci95)}
        )
        if key in PER_WEIGHT
        else p
        for key, p in group.parameters.items()
    }
    groups = {name: group.model_copy(update={"parameters": parameters})}
    models = model.models | {"nominal": fitted.model_copy(update={"groups": groups})}
    return model.model_copy(update={"models": models})


def of_rope(model: Model, found: Diagnosis, o: Observations, setup: Setup) -> list[TakenOver]:
    """Return what another run found that belongs to the rope, each with its name and its term: its
    values there, under their covariance. Weights count as in `frozen.weight_factor`."""
    out, factor = [], weight_factor(model.nominal, o)
    length = float(setup.properties.length.sum())
    for name, cause in (found.known | found.causes).items():
        effect = effect_of(cause)
        if not effect.of_rope or cause.covariance is None or not effect.possible(setup):
            continue
        places = [1.0] * len(effect.place_names)
        scale = effect.weighted(factor)
        usual = np.array(
            [*(q.size(setup) for q in effect.quantities), *(length * p for p in places)]
        )
        covariance = cause.covariance * np.outer(scale, scale) + np.diag((LEAST_SD * usual) ** 2)
        lower, upper = effect.bounds(setup)
        least = np.array([*lower, *(0.0 for _ in places)])
        most = np.array([*upper, *(WIDEST.get(p, 1.0) * length for p in effect.place_names)])

        def apply(setup: Setup, v: np.ndarray, effect=effect, least=least, most=most) -> Setup:
            return effect.apply(setup, np.clip(v, least, most))

        one = np.ones(len(usual))
        units = (*(q.unit for q in effect.quantities), *("m" for _ in places))
        term = Term(
            effect.name, effect.names, units, apply, scale * cause.values, usual, -np.inf * one,
            np.inf * one, np.inf * one,
        )  # fmt: skip
        bounded = correlated(effect.name, [term], covariance, bounds=(least, most))
        term = replace(bounded, effect=effect)
        out.append((f"known_{name}", cause, term))
    return out


def held_alike(term: Term, end: int, model: Model, found: Diagnosis | None) -> Term:
    """Return the turn of a clamp that a held pair of markers tells, as another run knows it.

    The pair sits on the rope: how far its line lies from the rope's own goes with it from recording
    to recording, give or take how well a clamp's direction is known at all. Its roll does not.
    """
    stepped = model.nominal.stepped
    if term.name != f"clamp_{end}" or stepped is None:
        return term
    known = found.calibration if found else stepped.calibration
    start, prior = term.start.copy(), term.prior.copy()
    for k, axis in enumerate(term.names[:2]):
        there = known.get(calibration_name(term, axis))
        if there is not None and np.isfinite(there.sd):
            sd = float(np.hypot(there.sd, Priors.end_orientation * DEGREE))
            if sd < prior[k]:
                start[k], prior[k] = there.value, sd
    return replace(term, start=start, prior=prior)
