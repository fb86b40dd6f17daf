"""An end that holds the rope's direction although it was assumed pinned, or a misaligned clamp."""

from __future__ import annotations

from itertools import product

import numpy as np

from ropefit.effects.base import Derived, Effect, Quantity
from ropefit.effects.drawn import Drawn, components
from ropefit.effects.ends import end_next_to, turned_clamp, where
from ropefit.effects.kink import Kink
from ropefit.effects.misfit import Misfit
from ropefit.rod.quaternion import smallest_rotation
from ropefit.rod.setup import Setup

RIGID = 1e3  # N m/rad: no rope shows that a clamp this stiff yields
LARGEST = 1e12  # rad/(N m): beyond, it is no clamp
# From the middle of a cube to its corners, edges and faces.
DIRECTIONS = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if any(d)])
EDGES = (DIRECTIONS != 0).sum(axis=1) == 2


class ClampedEnd(Effect):
    """A pinned end with an elastic clamp: `stiffness` [N m/rad], infinite where it is rigid, to a
    direction fixed in space (from end 0 towards end 1), of any length."""

    name = "clamped_end"
    of_simulators = True
    locus = "end"
    quantities = (
        Quantity(
            "stiffness", "N m/rad", 0.02, lower=0.0, by_weight=1.0, by_length=1.0, saturates=True,
            derived=Derived("compliance", "rad/(N m)", lambda k: 1 / max(k, 1 / LARGEST)),
        ),
        *(Quantity(f"direction_{axis}", "1", 0.3) for axis in "xyz"),
    )  # fmt: skip
    shaping = 3
    direction = ("direction_x", "direction_y", "direction_z")

    @property
    def tangent(self) -> bool:
        return False  # a stepped rope has no joint there before

    def applies(self, setup: Setup) -> bool:
        free = bool(np.isnan(setup.ends[:, self.end]).any())
        return not setup.clamped[self.end] and not free

    def scan_places(self, setup: Setup) -> np.ndarray:
        """Return (26, 3) directions, evenly spread; (14, 3) in motion, where each is a
        simulation."""
        some = DIRECTIONS if setup.damping is None else DIRECTIONS[~EDGES]
        return some / np.linalg.norm(some, axis=1, keepdims=True)

    def unit_loads(self, setup: Setup, x: np.ndarray, place: np.ndarray) -> np.ndarray:
        """Return the clamp's moment on the last segment t, t x direction, as the force across it
        on its inner node."""
        held, inner = (0, 1) if self.end == 0 else (-1, -2)
        segment = (x[:, inner] - x[:, held]) * (1 if self.end == 0 else -1)
        length = np.linalg.norm(segment, axis=-1, keepdims=True)
        tangent = segment / length
        load = np.zeros((len(x), 1, *x.shape[1:]))
        across = place - (tangent @ place)[:, None] * tangent
        load[:, 0, inner] = across / length * (1 if self.end == 0 else -1)
        return load

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        way = values[1:4] / np.sqrt((values[1:4] * values[1:4]).sum() + 1e-30)
        clamp, soft = setup.clamp.copy(), np.zeros((2, 2))
        clamp[:, self.end] = smallest_rotation(np.array([0.0, 0.0, 1.0]), way)
        # The spring bends only: pinned ends let the rope spin.
        with np.errstate(divide="ignore"):  # one without stiffness holds nothing
            soft[self.end] = 1 / values[0], np.inf
        clamped = tuple(True if e == self.end else c for e, c in enumerate(setup.clamped))
        return setup._replace(
            clamp=clamp,
            clamp_compliance=setup.clamp_compliance + soft,
            clamped=clamped,  # type: ignore[arg-type]
        )

    def sentence(self, values: dict[str, float]) -> str:
        size = values["stiffness"]
        how = "rigidly" if size > RIGID else f"with {size:.3g} N·m per radian"
        return f"{where(self.end)} holds the rope's direction, {how}"

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("clamp", vector=components(values, "direction_"))


class TiltedClamp(Effect):
    """A clamp misaligned with its recorded direction: a turn [rad] about two axes across it."""

    name = "clamped_end"
    of_simulators = True
    locus = "end"
    vector = ("tilt", "rad")
    calibrated = True
    quantities = (Quantity("tilt_1", "rad", 0.05), Quantity("tilt_2", "rad", 0.05))

    @property
    def tangent(self) -> bool:
        return False  # usual tilts bend the rope out of proportion

    def applies(self, setup: Setup) -> bool:
        return setup.clamped[self.end]

    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        return turned_clamp(setup, self.end, np.append(values, 0.0))

    def starts_beside(
        self, leader: Effect, values: np.ndarray, misfit: Misfit
    ) -> list[list[np.ndarray]]:
        """Propose the turn of a kink next to this end: a large one the scan does not show."""
        if not isinstance(leader, Kink) or leader.vector is None:
            return []
        share = values[-1] / float(misfit.setup.properties.length.sum())
        if end_next_to(share) != self.end:
            return []
        return [[values[:2] if self.end == 0 else -values[:2]]]

    def sentence(self, values: dict[str, float]) -> str:
        size = (values["tilt_1"] ** 2 + values["tilt_2"] ** 2) ** 0.5
        return (
            f"the clamp at {where(self.end)} points {size * 57.2958:.3g}° away from the recorded "
            "direction"
        )

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        return Drawn("clamp")
