"""Everything that decides what a recording shows: the rope, what holds it, and how it is seen.

Parameters, calibration errors and effects all act on this one picture; see `effects/`.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from ropefit.rod.bending import Bending
from ropefit.rod.either import Array, like
from ropefit.rod.memory import Branch
from ropefit.rod.moving import Damping
from ropefit.rod.off_axis import off_axis, sides_at_nodes
from ropefit.rod.path import EndPath
from ropefit.rod.potential import Potential
from ropefit.rod.rod import Properties, Rod, arc_length, at_nodes, build
from ropefit.rod.sensor import SensorModel

RIGIDITY = 300.0  # times a rope's: of a rigid piece


class Follower(NamedTuple):
    """A force (3,) [N] in the rope's own frame, which turns with it: on the nodes by their share
    (N+1,), carried by the segments' frames by their weight (N,); both sum to 1."""

    share: np.ndarray
    weight: np.ndarray
    force: np.ndarray


class SolverError(Protocol):
    """What an error of the solver that simulated the shapes does to what is seen of the nodes."""

    @property
    def move(self) -> np.ndarray:
        """Return (F, N+1, 3) [m] by how much it moves them."""
        ...

    def slope(self, a: Any, b: Any) -> np.ndarray:
        """Return (F, N+1, 3) the derivative of that where the error goes from a to b about it."""
        ...

    def frames(self, index: np.ndarray) -> SolverError:
        """Return it in some of the frames."""
        ...


class Motion(NamedTuple):
    """How the rope moved in each of F frames, as observed: velocity (F, N+1, 3) [m/s] and
    acceleration (F, N+1, 3) [m/s²] of the nodes."""

    velocity: np.ndarray
    acceleration: np.ndarray

    def frames(self, index: np.ndarray) -> Motion:
        """Return the motion in some of the frames."""
        return Motion(*(item[index] for item in self))


class Past(NamedTuple):
    """What some frames of a recording were picked from: all its frames, of which `shown` (F,) are
    here, and what has been done to the setup since they were picked."""

    whole: Setup
    shown: np.ndarray
    changes: tuple[Callable[[Setup], Setup], ...] = ()


class Setup(NamedTuple):
    """F frames of one rope of N segments.

    properties: see `Properties`; gravity (3,) [m/s²]; load (N+1, 3) or (F, N+1, 3) [N]; mass (N+1,)
    [kg] attached to the nodes; moment
    (2, 3) [N m]; clamp_compliance (2, 2) [rad/(N m)]: rows of both ends, to bending and to twist;
    kinks (N+1, 3) [rad]; stretch (N,) [1/N]: axial compliance besides 1/EA; ends (F, 2, 3) [m],
    clamp (F, 2, 4), NaN where not held; clamped: whether each end is; sensor: how it reports
    points; potentials; rigid (N,): share of each segment that is inside a rigid piece. time (F,)
    [s]; memory: what remembers earlier frames, and past: those of them that are not among the F.
    bending: the law of bending, where it is not linear; axial (A,): that of axial strain, see
    `rod.axial`; drag (11,): that of the air, see `Moving`;
    springs (N+1,) [N/m] of the nodes to the origin, and bodies (b, 8) that they touch, in motion,
    see `Moving`; followers: forces that turn with the rope. weights (n,) or (F, n): of the moves of
    Algorithm 1, where that finds the shape. off_axis (N+1, 2) [m]: offset of the markers from the
    axis at the nodes, along the rope's first two directors. solver_error: of a simulation that is
    compared with.
    """

    properties: Properties
    gravity: np.ndarray
    load: np.ndarray
    mass: np.ndarray
    moment: np.ndarray
    clamp_compliance: np.ndarray
    kinks: np.ndarray
    stretch: np.ndarray
    ends: np.ndarray
    clamp: np.ndarray
    clamped: tuple[bool, bool]
    sensor: SensorModel
    potentials: tuple[Potential, ...] = ()
    rigid: np.ndarray | None = None
    damping: Damping | None = None  # of a rope that is simulated in motion
    motion: Motion | None = None  # None: a recording too slow or too sparse to show any
    end_path: EndPath | None = None  # None: poses that were held still
    time: np.ndarray | None = None
    memory: tuple[Branch, ...] = ()
    past: Past | None = None
    bending: Bending | None = None
    axial: np.ndarray | None = None
    drag: np.ndarray | None = None
    springs: np.ndarray | None = None
    bodies: np.ndarray | None = None
    followers: tuple[Follower, ...] = ()
    weights: np.ndarray | None = None
    off_axis: np.ndarray | None = None
    solver_error: SolverError | None = None

    @property
    def rubs(self) -> bool:
        """Return whether the rope touches something with friction."""
        return any(p.friction is not None for p in self.potentials)

    @property
    def remembers(self) -> bool:
        """Return whether a frame's shape depends on the frames before it."""
        return bool(self.memory) or self.rubs

    @property
    def possible(self) -> bool:
        """Return whether matter can be so: lengths, rigidities and density are positive everywhere,
        and nothing gets longer under compression."""
        p = self.properties
        positive = (p.length, p.bend, p.twist, p.density)
        return all(bool((v > 0).all()) for v in positive) and bool((self.stretch >= 0).all())

    @property
    def clock(self) -> np.ndarray:
        """Return (F,) [s] the time of the frames, a second a frame where none is known."""
        return np.arange(float(len(self.ends))) if self.time is None else self.time

    @property
    def segments(self) -> int:
        """Return N."""
        return self.kinks.shape[-2] - 1

    @property
    def arc(self) -> np.ndarray:
        """Return (N+1,) [m] the rest arc length of the nodes."""
        return arc_length(self.properties.length)

    @property
    def up(self) -> np.ndarray:
        """Return (3,) the unit vector against gravity."""
        with np.errstate(invalid="ignore"):  # NaN where there is no gravity
            return -self.gravity / np.linalg.norm(self.gravity)

    @property
    def weight(self) -> float:
        """Return the weight [N] of the whole rope."""
        mass = (self.properties.density * self.properties.length).sum()
        return mass * np.linalg.norm(self.gravity)

    def after(self, change: Callable[[Setup], Setup]) -> Setup:
        """Return the setup after a change, which the frames of its past will see as well."""
        out = change(self)
        if self.past is None:
            return out
        return out._replace(past=self.past._replace(changes=(*self.past.changes, change)))

    def whole(self) -> tuple[Setup, np.ndarray]:
        """Return all frames of the recording, and which of them (F,) are here."""
        if self.past is None:
            return self, np.arange(len(self.ends))
        out = self.past.whole
        for change in self.past.changes:
            out = change(out)
        return out, self.past.shown

    def frames(self, index: np.ndarray) -> Setup:
        """Return the rope in some of its frames; it has been through the others all the same."""
        past = self.past or Past(self, np.arange(len(self.ends)))
        return self._replace(
            time=None if self.time is None else self.time[index],
            past=past._replace(shown=past.shown[index]),
            ends=self.ends[index],
            clamp=self.clamp[index],
            sensor=self.sensor.frames(index),
            load=self.load[index] if self.load.ndim == 3 else self.load,
            motion=self.motion.frames(index) if self.motion else None,
            end_path=self.end_path.frames(index) if self.end_path else None,
            weights=w[index] if (w := self.weights) is not None and w.ndim == 2 else w,
            solver_error=self.solver_error and self.solver_error.frames(index),
        )

    @property
    def reported(self) -> SensorModel:
        """Return how points are reported, with what the solver's error does to them."""
        if self.solver_error is None:
            return self.sensor
        return self.sensor._replace(drift=self.sensor.drift + self.solver_error.move)

    def seen(self, x: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Return a copy (F, N+1, 3) [m] of where nodes x (F, N+1, 3) [m] are reported of a rope
        whose segments have frames q (F, N, 4)."""
        if self.off_axis is not None:
            x = x + off_axis(self.off_axis, sides_at_nodes(q))
        return self.reported(x).copy()

    def rod(self) -> Rod:
        """Return the discrete rod with all its loads."""
        p = self.properties
        if self.rigid is not None:  # whatever the rope itself is
            stiffer = 1 / (1 - (1 - 1 / RIGIDITY) * self.rigid)
            p = p._replace(bend=p.bend * stiffer, twist=p.twist * stiffer)
        rod = build(p, self.gravity, self.clamped, self.clamp_compliance, self.kinks)
        stretch = self.stretch[..., None] * like([0.0, 0.0, 1.0], rod.flexibility)
        return rod._replace(
            load=self.node_loads(),
            moment=rod.moment + self.moment,
            flexibility=rod.flexibility + stretch,
        )

    def node_loads(self) -> Array:
        """Return (N+1, 3) or (F, N+1, 3) [N] the dead loads on the nodes."""
        mass = at_nodes(0.5 * self.properties.density * self.properties.length) + self.mass
        return mass[..., None] * self.gravity + self.load


def twist_held(setup: Setup) -> bool:
    """Return whether an end keeps the rope from spinning about its tangent."""
    return any(
        held and bool(np.isfinite(setup.clamp_compliance[end, 1]))
        for end, held in enumerate(setup.clamped)
    )


def bare(
    properties: Properties,
    gravity: np.ndarray,
    ends: np.ndarray,
    clamp: np.ndarray,
    viewpoint: np.ndarray,
) -> Setup:
    """Return the setup without any effect. Shapes as in `Setup`; viewpoint (3,) [m]."""
    segments = properties.length.shape[-1]
    zero = np.zeros(3)
    held = [not np.isnan(clamp[:, end]).any() for end in range(2)]
    return Setup(
        properties=properties,
        gravity=gravity,
        load=np.zeros((segments + 1, 3)),
        mass=np.zeros(segments + 1),
        moment=np.zeros((2, 3)),
        clamp_compliance=np.zeros((2, 2)),
        kinks=np.zeros((segments + 1, 3)),
        stretch=np.zeros(segments),
        ends=ends,
        clamp=clamp,
        clamped=(held[0], held[1]),
        sensor=SensorModel(
            viewpoint,
            zero,
            zero[0],
            zero,
            zero[0],
            zero[0],
            np.zeros((len(ends), 1, 3)),
            np.zeros((len(ends), 1, 3)),
            zero,
            zero[0],
            zero,
            zero[0],
        ),
    )
