"""Recordings in which an effect is concealed, made in memory from a finer rod than is fitted."""

from __future__ import annotations

import numpy as np

from ropefit.effects import Effect
from ropefit.effects.obstacle import heading_across
from ropefit.effects.place import middle_of
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import Fit, fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare

EYE = (0.5, -1.6, 0.0)
EI = 5e-4
BINS = 30


def rope(segments: int, frames: int = 12, bend: float = EI) -> Setup:
    """A pinned rope of 1 m and 60 g whose end 0 sweeps, lifts and turns."""
    t = np.linspace(0, 1, frames)
    moving = np.stack(
        [
            0.55 + 0.25 * np.sin(2 * np.pi * t),
            0.25 * np.sin(4 * np.pi * t + 0.5),
            0.15 * np.cos(3 * np.pi * t),
        ],
        axis=1,
    )
    moving *= np.minimum(1, 0.93 / np.linalg.norm(moving, axis=1, keepdims=True))
    ends = np.stack([moving, np.zeros_like(moving)], axis=1)
    gravity = np.array([0.0, 0.0, -9.81])
    clamp = np.full((frames, 2, 4), np.nan)
    made = uniform(length=1.0, segments=segments, bend=bend, density=0.06)
    return bare(made, gravity, ends, clamp, np.array(EYE))


def recorded(setup: Setup, seed: int = 0, points: int = 240, sd: float = 0.001) -> Data:
    """What `scanned` makes of the ropes in equilibrium."""
    return scanned(Equilibrium(setup, []).at(np.empty(0)).seen, seed, points, sd)


def scanned(x: np.ndarray, seed: int = 0, points: int = 240, sd: float = 0.001) -> Data:
    """Points along ropes x (F, K, 3) with noise along the ray and one outlier in a hundred."""
    rng = np.random.default_rng(seed)
    frames, nodes = x.shape[:2]
    share = np.sort(rng.uniform(size=(frames, points)), axis=1)
    place = share * (nodes - 1)
    low = np.minimum(place.astype(int), nodes - 2)
    part = (place - low)[..., None]
    row = np.arange(frames)[:, None]
    on_rope = x[row, low] * (1 - part) + x[row, low + 1] * part
    ray = on_rope - np.array(EYE)
    ray /= np.linalg.norm(ray, axis=-1, keepdims=True)
    on_rope += ray * sd * rng.normal(size=(frames, points, 1))
    on_rope += 0.0004 * rng.normal(size=on_rope.shape)
    wild = rng.uniform(size=(frames, points)) < 0.01
    on_rope[wild] += 0.02 * rng.normal(size=(int(wild.sum()), 3))
    share = np.clip(share + 0.003 * rng.normal(size=share.shape), 0, 1)
    return Data(on_rope, share, np.ones(share.shape, bool), False, np.array(EYE))


def with_effect(effect: Effect, values: list[float], segments: int = 288) -> Setup:
    """The fine rope with an effect of values in SI."""
    return effect.apply(rope(segments), np.array(values))


def bar_under(free: Setup) -> np.ndarray:
    """Values (5,) of a bar across the rope that it touches where it hangs lowest, 5 mm deep."""
    nodes = Equilibrium(free, []).at(np.empty(0)).seen - middle_of(free)
    low = nodes.reshape(-1, 3)[nodes[..., 2].argmin()]
    values = np.array([*low, 0.025, heading_across(free)])
    values[2] += 0.03 - values[3]
    return values


def nominal_fit(data: Data, segments: int = 144) -> Fit:
    """EI and all calibration errors, the effect not known of."""
    setup = rope(segments, len(data.points), bend=3e-4)
    terms = [PARAMETERS["EI"].within(Range(3e-4, 3e-8, 3.0))]
    forward = Equilibrium(setup, [*terms, *calibration(setup, Priors(), False)])
    return fit(forward, FitProblem(data, Noise(), BINS))
