"""What an effect is: one piece of physics or of measurement that a model may include.

An effect changes a `Setup`. What is special about one (how the diagnosis looks for it, what is held
out for it, how it is exported) is in its own file: attributes and methods that it overrides.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np

from ropefit.effects.drawn import Drawn
from ropefit.effects.law import Law
from ropefit.effects.misfit import Misfit
from ropefit.effects.place import intervals_along, points_along
from ropefit.rod.setup import Setup

Kind = Literal["physics", "measurement", "solver"]
Locus = Literal["point", "interval", "end", "whole"]
PLACE_NAMES = {"point": ("arc_length",), "interval": ("centre", "width")}
MAY_LEAVE = 0.15  # of the nominal misfit: what an effect that explains a recording may leave


@dataclass(frozen=True)
class Derived:
    """A monotone function of a quantity, reported beside it under a name and unit of its own."""

    name: str
    unit: str
    of: Callable[[float], float]


@dataclass(frozen=True)
class Quantity:
    """A number of an effect: unit, bounds, and its usual size, at which the diagnosis starts.

    The size may depend on the rope: `scale` is then a multiple of its weight [N] per power of its
    weight and length: size = scale * weight**by_weight * length**by_length; and be one of times:
    then it is a multiple of the recording's duration [s] as well. `inexact` is the relative error
    that remains without noise: added to the standard error in quadrature. `derived` is reported
    beside the quantity. `saturates`: sizes far above the usual one do the same, and infinity is
    within reach. `open_ended`: so do sizes beyond its bounds, where a fit may end without harm.
    """

    name: str
    unit: str
    scale: float
    lower: float = -float("inf")
    upper: float = float("inf")
    by_weight: float = 0.0
    by_length: float = 0.0
    by_time: float = 0.0
    inexact: float = 0.0
    derived: Derived | None = None
    saturates: bool = False
    open_ended: bool = False

    def size(self, setup: Setup) -> float:
        """Return the usual size for this rope, in SI."""
        weight, length = float(setup.weight), float(setup.properties.length.sum())
        size = self.scale * weight**self.by_weight * length**self.by_length
        return size if self.by_time == 0.0 else size * duration(setup) ** self.by_time


@dataclass(frozen=True)
class Calibration:
    """An error of the set-up that every fit allows for: an effect at small sizes, under a prior.

    name: of the term (an end's number is added), values: of its values; prior: field of
    `models.priors.Priors` with one sigma, in SI or in degrees; own_sensor: only where rope and
    ends are observed by different sensors.
    """

    name: str
    values: tuple[str, ...]
    prior: str
    degrees: bool = False
    own_sensor: bool = False


class SpecialCase(NamedTuple):
    """What an effect is where some of its values are not significantly different from zero (those
    with a lower bound above zero: from that bound).

    effect: the special one; vanishing: names of those values; values: its values (SI) from those
    of the general one, None where it cannot have them; general: the contrary, if needed.
    """

    effect: type[Effect]
    vanishing: tuple[str, ...]
    values: Callable[[Setup, np.ndarray], np.ndarray | None]
    general: Callable[[Setup, np.ndarray], np.ndarray] | None = None


class Exported(NamedTuple):
    """How an effect goes into a simulator.

    beside: everything beside the rope so far, with what this effect adds (records of
    `attachments`). settles: `apply` changes the rope that ropefit settles for comparison;
    in_rope: it changes the exported rope, too. note: what the export cannot express.
    """

    beside: tuple[Any, ...]
    settles: bool = True
    in_rope: bool = False
    note: str = ""


class Effect(ABC):
    """One file an effect. Values are given in SI: the `quantities`, then the place.

    The place is nothing for locus "whole" and "end" (there `end` is 0 or 1), the arc length [m] for
    "point", centre and width [m] for "interval". At zero quantities an effect does nothing.
    """

    name: ClassVar[str]
    kind: ClassVar[Kind] = "physics"
    locus: ClassVar[Locus] = "whole"
    quantities: ClassVar[tuple[Quantity, ...]]
    # Shapes change in proportion at small sizes: a start may be scaled down until it settles.
    linear: ClassVar[bool] = True
    # The number of quantities, the last ones, that say how the effect acts, not how much: the scan
    # tries them at these multiples of their usual sizes.
    shaping: ClassVar[int] = 0
    tries: ClassVar[tuple[float, ...]] = (1.0,)
    # Multiples of a start's sizes, ascending, the best of which a fit begins with, where a fit that
    # begins elsewhere stops in a local minimum; by default the first that makes the misfit smaller.
    start_shares: ClassVar[tuple[float, ...]] = ()
    # Quantities that are components of one vector are reported as its size, of this name and unit.
    vector: ClassVar[tuple[str, str] | None] = None

    # Names of quantities that are components of a direction: their common size changes nothing.
    direction: ClassVar[tuple[str, ...]] = ()

    # Simpler effects that this one contains: one of them is named where it explains as much.
    special_cases: ClassVar[tuple[SpecialCase, ...]] = ()

    # The scan looks for it at small sizes; if not, only its own `starts` do.
    scanned: ClassVar[bool] = True
    # Noise that is measured beside all scanned effects may still contain it: it is fitted first.
    looks_like_noise: ClassVar[bool] = False
    # Its response depends on the frames before even at zero size: the derivative follows the path.
    path_dependent: ClassVar[bool] = False
    # It is a rest curvature of a rope that is free to spin, which turns until that costs least.
    turns_rope: ClassVar[bool] = False
    # A simulator may have it unknown to its user: looked for in simulated shapes.
    of_simulators: ClassVar[bool] = False
    # It can be simulated in motion: no potential but contact, no memory, nothing that needs rest.
    in_motion: ClassVar[bool] = True
    # Fits are slow (contact comes and goes): after all others, and only while they gain.
    slow: ClassVar[bool] = False
    # To apply it takes longer than to solve for the rope: it is differenced to one side.
    costly: ClassVar[bool] = False
    # After all others, too, but fitted like them.
    late: ClassVar[bool] = False
    # What is held out to test it: blocks of frames, or stretches of rope where it acts in so few
    # neighbouring frames that none predicts the others.
    held_out: ClassVar[Literal["frames", "stretches"]] = "frames"
    # Small sizes are an error of the set-up: the prior judges them, not held-out frames.
    calibrated: ClassVar[bool] = False
    calibration: ClassVar[Calibration | None] = None
    # Usual sizes beyond which a linear effect is refused: it stands for something else.
    implausible: ClassVar[float] = 30.0
    # Quantities that are mostly within three usual sizes of zero: where one is significantly
    # beyond, other effects that explain as much are named before.
    nearly_zero: ClassVar[tuple[str, ...]] = ()
    # Counts against the number of effects that may be accepted.
    counted: ClassVar[bool] = True
    # Where it is accepted, a recording is explained down to noise.
    exact: ClassVar[bool] = True
    may_leave: ClassVar[float] = MAY_LEAVE
    # A force with so many freedoms that it stands for much else: it explains a recording at rest
    # only where it leaves little more than noise.
    stands_for_others: ClassVar[bool] = False
    # It belongs to the rope, wherever that is recorded: `--nominal` takes it over.
    of_rope: ClassVar[bool] = False
    # It may come between two recordings of one rope: a law of its material does not.
    changes: ClassVar[bool] = True
    # The name by which `identify --law` fits its curve, if it begins at zero.
    asked_as: ClassVar[str] = ""
    # The form of a law without a variable, whose constants are the effect's own quantities, and why
    # it has no curve.
    constant: ClassVar[str] = ""
    no_curve: ClassVar[str] = ""
    # Advice for recordings in which the rope's own parameters explain the effect as well.
    confounding: ClassVar[str] = ""

    def __init__(self, end: int = 0) -> None:
        self.end = end

    def applies(self, setup: Setup) -> bool:
        """Return whether the effect can occur in this setup at all."""
        return True

    def possible(self, setup: Setup) -> bool:
        """Return whether the effect can occur in this setup and be simulated as it is: at rest, or
        in motion."""
        return (setup.damping is None or self.in_motion) and self.applies(setup)

    @abstractmethod
    def apply(self, setup: Setup, values: np.ndarray) -> Setup:
        """Return the setup with the effect, of the sizes and at the place in values (n,)."""

    @abstractmethod
    def sentence(self, values: dict[str, float]) -> str:
        """Describe the effect, given quantities and place by name (arc_length, centre, width)."""

    def unseen(self, size: float) -> tuple[str, str]:
        """Return a topic, and a sentence about it where the effect was not found and
        would have been from this size of its first quantity on; by default nothing."""
        return "", ""

    def bounds(self, setup: Setup) -> tuple[list[float], list[float]]:
        """Return the least and the greatest quantities that this rope allows."""
        return [q.lower for q in self.quantities], [q.upper for q in self.quantities]

    @property
    def tangent(self) -> bool:
        """Return whether the scan takes the derivative at zero, or the response to a finite
        size."""
        return self.linear or self.path_dependent

    @property
    def prior_decides(self) -> bool:
        """Return whether its prior is its test: held-out frames cannot tell it from the set-up's
        error."""
        return self.kind == "measurement" or self.calibrated

    def unit_loads(self, setup: Setup, x: np.ndarray, place: np.ndarray) -> np.ndarray | None:
        """Return (F, k, N+1, 3) [N] on nodes x (F, N+1, 3) [m] per unit of each quantity.

        For effects that are forces in proportion to their quantities; None: the scan uses `apply`.
        """
        return None

    def scan_places(self, setup: Setup) -> np.ndarray:
        """Return (Q, p) what the scan tries: shaping quantities, or places on the rope [m]."""
        if self.shaping:
            usual = [q.size(setup) for q in self.quantities[-self.shaping :]]
            return np.array([[share * size for size in usual] for share in self.tries])
        if self.locus == "point":
            return points_along(setup)
        return intervals_along(setup) if self.locus == "interval" else np.zeros((1, 0))

    def begun_before(self, setup: Setup, x: np.ndarray) -> np.ndarray:
        """Return (F,) bool: frames in which the effect acts by what was before the recording, or
        after it, with the nodes at x (F, N+1, 3) [m]; by default none."""
        return np.zeros(len(x), dtype=bool)

    def starts(self, misfit: Misfit) -> list[list[np.ndarray]]:
        """Return values (n,) from which full fits start, as proposed by what a fit leaves.

        Each inner list is one start and its alternatives: the first that settles is taken.
        """
        return []

    def starts_beside(
        self, leader: Effect, values: np.ndarray, misfit: Misfit
    ) -> list[list[np.ndarray]]:
        """Return further starts where another effect, fitted with `values`, explains most."""
        return []

    def more_usual(self, setup: Setup, values: np.ndarray) -> np.ndarray | None:
        """Return values (n,) that do the same, in proportion, and are more usual, if there are."""
        return None

    def borne(self, values: np.ndarray, misfit: Misfit) -> tuple[np.ndarray, np.ndarray] | None:
        """Return the centre (3,) [m] of what an effect of such values bears in the frame where it
        bears most, against the middle of the ends, and the direction (3,) in which it pushes.
        None: it bears nothing."""
        return None

    def start_sd(self, setup: Setup) -> np.ndarray:
        """Return (n,) one sigma of all values about where a fit starts; inf: no prior."""
        return np.full(len(self.names), np.inf)

    def law(self, setup: Setup) -> Law | None:
        """Return what the curve is of which the quantities are values, if there is one."""
        return None

    def exported(
        self, values: dict[str, float], setup: Setup, nodes: int, beside: tuple[Any, ...]
    ) -> Exported:
        """Return how the effect goes into a simulator: by default as a change of the rope.

        setup: with the effect; nodes: of the exported rope; beside: what other effects have added.
        """
        return Exported(beside, in_rope=True)

    def exported_form(
        self, form: str, constants: dict[str, float], beside: tuple[Any, ...]
    ) -> Exported | None:
        """Return how a law of a form that was named, with its constants [SI] by name, goes into a
        simulator; None: as `exported` has the effect."""
        return None

    def drawn(self, values: dict[str, float], gravity: np.ndarray) -> Drawn:
        """Return how a picture shows the effect, in a recording of gravity (3,) [m/s^2]."""
        return Drawn()

    @property
    def error_name(self) -> str:
        """Return the name of the term that it is as an error of the set-up; empty if it is none."""
        if self.calibration is None:
            return ""
        name = self.calibration.name
        return f"{name}_{self.end}" if self.locus == "end" else name

    @property
    def place_names(self) -> tuple[str, ...]:
        return PLACE_NAMES.get(self.locus, ())

    @property
    def names(self) -> tuple[str, ...]:
        """Return the names of all values, in order."""
        return (*(q.name for q in self.quantities), *self.place_names)

    def weighted(self, factor: float) -> np.ndarray:
        """Return (n,) by what the values change for a rope of `factor` times the weight."""
        places = [1.0] * len(self.place_names)
        return np.array([*(factor**q.by_weight for q in self.quantities), *places])


def duration(setup: Setup) -> float:
    """Return the time [s] from the first frame to the last."""
    return max(float(setup.clock.max() - setup.clock.min()), 1e-9)
