"""The terms of the nominal model: rope parameters, and calibration errors with their priors.

A calibration error that is also an effect is that effect, under its prior.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ropefit.effects import (
    DepthBias,
    DepthGain,
    EndOffset,
    GravityMisalignment,
    ScaleError,
    TimeLag,
)
from ropefit.effects.base import turned_clamp
from ropefit.models.equilibrium import Apply, Term
from ropefit.rod.setup import Setup

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
    """A calibration error: zero, give or take its prior."""
    prior = np.array(sd)
    return Term(
        name, tuple(names), tuple(units), apply, np.zeros(len(sd)), prior, -30 * prior, 30 * prior,
        prior, nuisance=True,
    )  # fmt: skip


def turn_camera(setup: Setup, v: Tensor) -> Setup:
    return setup._replace(seen=setup.seen._replace(rotation=setup.seen.rotation + v))


def shift_camera(setup: Setup, v: Tensor) -> Setup:
    return setup._replace(seen=setup.seen._replace(shift=setup.seen.shift + v))


def turn_clamp(end: int) -> Apply:
    """The clamp is turned by v (3,) [rad] about its own axes, in every frame alike."""
    return lambda setup, v: turned_clamp(setup, end, v)


def calibration(setup: Setup, priors: Priors, shared: bool, surface: float = 0.0) -> list[Term]:
    """All calibration errors as nuisances.

    shared: data and ends come from the same sensor, whose errors then turn and shift both alike
    (the rest of it is the error of gravity), and whose clock is one. surface [m]: one sigma of how
    far the points lie in front of the rope's axis, besides what preprocess corrected.
    """
    d, m = DEGREE, "m"
    terms = []
    if not shared:
        rotation = priors.camera_rotation * d
        terms += [
            nuisance("camera_rotation", ["x", "y", "z"], ["rad"] * 3, turn_camera, [rotation] * 3),
            nuisance(
                "camera_translation", ["x", "y", "z"], [m] * 3, shift_camera,
                [priors.camera_translation] * 3,
            ),
            nuisance("depth_gain", ["gain"], ["1"], DepthGain().apply, [priors.depth_gain]),
        ]  # fmt: skip
        if TimeLag().applies(setup):
            terms.append(nuisance("clock", ["lag"], ["s"], TimeLag().apply, [priors.time_lag]))
    if surface > 0:
        terms.append(nuisance("surface", ["depth"], [m], DepthBias().apply, [surface]))
    terms += [
        nuisance("scale", ["scale"], ["1"], ScaleError().apply, [priors.scale]),
        nuisance(
            "gravity", ["x", "y"], ["rad"] * 2, GravityMisalignment().apply,
            [priors.gravity * d] * 2,
        ),
    ]  # fmt: skip
    for end in range(2):
        if not bool(torch.isnan(setup.ends[:, end]).any()):
            terms.append(
                nuisance(
                    f"end_{end}", ["x", "y", "z"], [m] * 3, EndOffset(end).apply,
                    [priors.end_position] * 3,
                )
            )  # fmt: skip
        if setup.clamped[end]:
            terms.append(
                nuisance(
                    f"clamp_{end}", ["x", "y", "z"], ["rad"] * 3, turn_clamp(end),
                    [priors.end_orientation * d] * 3,
                )
            )  # fmt: skip
    return terms
