"""The terms of the nominal model: rope parameters, and calibration errors with their priors.

A calibration error that is also an effect is that effect, under its prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ropefit.effects import CATALOGUE, Effect
from ropefit.effects.ends import turned_clamp
from ropefit.effects.place import QUARTERS
from ropefit.models.terms import Apply, Term
from ropefit.rod.setup import Setup, twist_held

DEGREE = math.pi / 180
PAIR = 30.0  # degrees: how far the line of two held markers may lie from the rope's own


@dataclass(frozen=True)
class Priors:
    """One-sigma uncertainty of the set-up: degrees, metres, seconds, kilograms; scales are ratios.

    length and mass are None where the recording's are taken as exact.
    """

    camera_rotation: float = 0.2
    camera_translation: float = 0.002
    scale: float = 0.003
    depth_gain: float = 0.005
    gravity: float = 0.2
    end_position: float = 0.0015
    end_orientation: float = 1.0
    time_lag: float = 0.003
    length: float | None = None
    mass: float | None = None


def nuisance(name: str, names: list[str], units: list[str], apply: Apply, sd: list[float]) -> Term:
    """Return a calibration error: zero, give or take its prior."""
    prior = np.array(sd)
    return Term(
        name, tuple(names), tuple(units), apply, np.zeros(len(sd)), prior, -30 * prior, 30 * prior,
        prior, nuisance=True,
    )  # fmt: skip


def turn_camera(setup: Setup, v: np.ndarray) -> Setup:
    return setup._replace(sensor=setup.sensor._replace(rotation=setup.sensor.rotation + v))


def shift_camera(setup: Setup, v: np.ndarray) -> Setup:
    return setup._replace(sensor=setup.sensor._replace(shift=setup.sensor.shift + v))


def turn_clamp(end: int) -> Apply:
    """Return the clamp is turned by v (3,) [rad] about its own axes, in every frame alike."""
    return lambda setup, v: turned_clamp(setup, end, v)


def calibration(setup: Setup, priors: Priors, shared: bool, surface: float = 0.0) -> list[Term]:
    """Return all calibration errors as nuisances: the camera, effects that are one, the clamps.

    shared: data and ends come from the same sensor, whose errors then turn and shift both alike
    (the rest of it is the error of gravity), and whose clock is one. surface [m]: one sigma of how
    far the points lie in front of the rope's axis, besides what preprocess corrected.
    """
    sd = {**vars(priors), "surface": surface}
    terms = []
    if not shared:
        rotation = priors.camera_rotation * DEGREE
        terms += [
            nuisance("camera_rotation", ["x", "y", "z"], ["rad"] * 3, turn_camera, [rotation] * 3),
            nuisance(
                "camera_translation", ["x", "y", "z"], ["m"] * 3, shift_camera,
                [priors.camera_translation] * 3,
            ),
        ]  # fmt: skip
    for end in (None, 0, 1):
        for kind in CATALOGUE:
            if (kind.locus == "end") == (end is not None):
                terms += _small_effect(kind(end or 0), setup, sd, shared)
        if end is not None and setup.clamped[end]:
            terms.append(
                nuisance(
                    f"clamp_{end}", ["x", "y", "z"], ["rad"] * 3, turn_clamp(end),
                    [priors.end_orientation * DEGREE] * 3,
                )
            )  # fmt: skip
    return terms


def markers_off_axis(setup: Setup, sd: float) -> list[Term]:
    """Return the offsets [m] of markers from the rope's axis as a nuisance: two across it, which
    turn with the rope, at each of its quarters but the first, of one sigma `sd`; linear in between.
    None where no clamp holds the rope's twist."""
    if not twist_held(setup) or sd <= 0:
        return []
    names = [f"{axis}_at_{place}" for axis in (1, 2) for place in QUARTERS[1:]]
    return [nuisance("off_axis", names, ["m"] * len(names), _off_axis, [sd] * len(names))]


def _off_axis(setup: Setup, v: np.ndarray) -> Setup:
    share, places = setup.arc / setup.arc[-1], 0.01 * np.array(QUARTERS)
    parts = [np.interp(share, places, [0.0, *part]) for part in v.reshape(2, -1)]
    before = 0.0 if setup.off_axis is None else setup.off_axis
    return setup._replace(off_axis=before + np.stack(parts, axis=-1))


def _small_effect(
    effect: Effect, setup: Setup, priors: dict[str, float], shared: bool
) -> list[Term]:
    """Return the term of an effect that is a calibration error, where the set-up can have it."""
    error = effect.calibration
    if error is None or (shared and error.own_sensor) or not effect.applies(setup):
        return []
    sd = priors[error.prior] * (DEGREE if error.degrees else 1.0)
    if sd <= 0:
        return []
    units = [q.unit for q in effect.quantities]
    return [nuisance(effect.error_name, list(error.values), units, effect.apply, [sd] * len(units))]
