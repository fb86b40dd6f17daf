"""Laws of random form for the blind recordings of `laws`: what is drawn, and its constants."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import PchipInterpolator

from benchmarks.discovery.concealed_errors import follower_force
from benchmarks.discovery.concealment import Concealed, with_field
from benchmarks.discovery.setting import Setting, World
from reference_simulators.history_dependent_rod import Law
from reference_simulators.rod_equations import Array, Field

STRETCH = (0.15, 0.3)  # strain under its own weight, of a rope whose stretch follows a law
Function = Callable[[Array], Array]


@dataclass(frozen=True)
class Drawn:
    """A law as drawn: what is concealed, what the name of its form contains (empty: it has none),
    and its constants by the size."""

    concealed: Concealed
    form: str
    constants: Callable[[float], dict[str, float]]


def tabulated(moment: Function, highest: float) -> Callable[[Array], tuple[Array, Array]]:
    """Return the curvature, and its derivative, of a moment; linear beyond `highest` [1/m]."""
    k = np.concatenate([[0.0], np.geomspace(1e-4 * highest, highest, 4000)])
    inverse = PchipInterpolator(moment(k), k)
    slope, top = inverse.derivative(), float(moment(k[-1:])[0])

    def bent(m: Array) -> tuple[Array, Array]:
        inside = np.minimum(m, top)
        rate = slope(inside)
        return inverse(inside) + rate * (m - inside), rate

    return bent


def bending(setting: Setting, rng: np.random.Generator) -> Drawn:
    """Draw a form: a power, a + b k², or tanh. The size takes the law away from the linear one."""
    rod, turn = setting.rod, setting.states[..., 10:]
    usual = float(np.quantile(np.linalg.norm(turn, axis=-1), 0.9)) / rod.bending
    kind = str(rng.choice(["power-", "power+", "cubic", "tanh"]))

    def truth(size: float) -> tuple[Function, dict[str, float]]:
        if kind.startswith("power"):
            n = 1 / (1 + size) if kind == "power-" else 1 + size
            # Of finite slope at zero, far below all curvatures.
            return lambda k: rod.bending * k * ((k / usual) ** 2 + 1e-4) ** ((n - 1) / 2), {"n": n}
        if kind == "cubic":
            return lambda k: rod.bending * k * (1 + size * (k / usual) ** 2), {
                "b": rod.bending * size / usual**2
            }
        return (
            lambda k: (
                rod.bending * usual / size * (np.tanh(k * size / usual) + 1e-3 * k * size / usual)
            ),
            {"k0": usual / size},
        )

    def change(world: World, size: float) -> World:
        table = tabulated(truth(size)[0], 20 * usual)
        return replace(world, rod=replace(world.rod, bent=table))

    forms = {"power-": "(n-1)", "power+": "(n-1)", "cubic": "b > 0", "tanh": "tanh"}
    most = {"power-": 2.0, "power+": 1.5, "cubic": 30.0, "tanh": 3.0}[kind]
    concealed = Concealed("bending_law", "unknown", change, 0.2, most, kind, "1", follows=True)
    return Drawn(concealed, forms[kind], lambda size: truth(size)[1])


def axial(setting: Setting, rng: np.random.Generator) -> Drawn:
    """Draw a form of tension over strain: a power, a + b e², tanh, or one that locks. Where the
    rope is usually pulled it is as stiff as without."""
    rod = setting.rod
    kind = str(rng.choice(["power-", "power+", "cubic", "tanh", "locking"]))
    # A tension that no longer grows must be beyond all that the rope is under.
    at = (1.0 if kind == "tanh" else 0.3) * rod.density * rod.length * 9.81
    usual = rod.compliance * at

    def truth(size: float) -> tuple[Function, dict[str, float]]:
        if kind.startswith("power"):
            n = 1 / (1 + size) if kind == "power-" else 1 + size
            # Of finite slope at zero, far below all strains.
            return lambda e: at * e / usual * ((e / usual) ** 2 + 1e-4) ** ((n - 1) / 2), {"n": n}
        if kind == "cubic":
            a = at / usual / (1 + size)
            return lambda e: a * e * (1 + size * (e / usual) ** 2), {"b": a * size / usual**2}
        if kind == "tanh":
            high = np.tanh(size)
            return lambda e: at / high * (np.tanh(size * e / usual) + 1e-3 * size * e / usual), {
                "e0": usual / size
            }
        share = size / (1 + size)  # of the strain at which it locks, that it usually has
        high = -np.log1p(-share)

        def locking(e: Array) -> Array:
            part = np.minimum(share * e / usual, 0.999)
            return at / high * (-np.log1p(-part) + 1e3 * np.maximum(share * e / usual - 0.999, 0))

        return locking, {"e0": usual / share}

    def change(world: World, size: float) -> World:
        table = tabulated(truth(size)[0], 10 * usual)

        def stretched(tension: Array) -> tuple[Array, Array]:
            strain, rate = table(np.abs(tension))
            return np.sign(tension) * strain, rate

        return replace(world, rod=replace(world.rod, stretched=stretched))

    forms = {"power-": "e^n", "power+": "e^n", "cubic": "b e^3", "tanh": "tanh", "locking": "ln("}
    most = {"power-": 2.0, "power+": 3.0, "cubic": 60.0, "tanh": 4.0, "locking": 30.0}[kind]
    concealed = Concealed("axial_law", "unknown", change, 0.2, most, kind, "1", follows=True)
    return Drawn(concealed, forms[kind], lambda size: truth(size)[1])


def force_field(setting: Setting, rng: np.random.Generator) -> Drawn:
    """Draw a point or a wall that repels or attracts the rope, by a power of the distance or
    exponentially; or a force that fills the room behind a plane."""
    sign = float(rng.choice([-1.0, 1.0]))
    weight = setting.rod.density * 9.81
    way = rng.standard_normal(3)
    way /= np.linalg.norm(way)
    kind = str(rng.choice(["point power", "point exp", "wall power", "wall exp", "filled"]))
    x = setting.states[..., :3]
    if kind.startswith("point"):
        place = int(rng.uniform(0.35, 0.65) * len(setting.problem.mesh))
        point, axis, what = x[:, place].mean(axis=0), np.zeros(3), "bar"
        point = point + rng.uniform(0.1, 0.25) * way
    else:
        along = x @ way
        behind = rng.uniform(0.03, 0.1)
        if kind == "filled":
            behind = -rng.uniform(0.3, 0.7) * float(np.ptp(along))
        point, axis, what = (float(along.min()) - behind) * way, way, "plane"
    n, span = float(rng.uniform(1.0, 3.0)), float(rng.uniform(0.04, 0.15))
    if kind == "filled":
        field = Field(point, axis, 0.01, sign, what, filled=True)
        # Told along the force.
        form, constants = "x < x1" if sign > 0 else "x > x1", {}
    elif kind.endswith("power"):
        field = Field(point, axis, 0.1 * setting.rod.length, sign, what, power=n)
        form, constants = ")^n", {"n": n}
    else:
        # Told along the force, which an attracting wall has towards itself.
        told = span if kind == "point exp" else sign * span
        field = Field(point, axis, span, sign, what, soft=True)
        form, constants = "/lambda)", {"lambda": told}
    change = with_field(lambda size: replace(field, hardness=sign * size))
    concealed = Concealed(
        "force_field", "unknown", change, 0.05 * weight, 50 * weight, "strength", "N/m",
        follows=True,
    )  # fmt: skip
    return Drawn(concealed, form, lambda _: constants)


def follower(setting: Setting, rng: np.random.Generator) -> Drawn:
    """Draw a jet that turns with the rope; it has no form."""
    return Drawn(follower_force(setting, rng), "", lambda _: {})


def hysteresis(setting: Setting, rng: np.random.Generator) -> Drawn:
    """Draw friction inside the rope by Dahl's law. Size: the largest moment [N m]."""
    rod, span = setting.rod, float(rng.uniform(0.5, 2.0)) / setting.rod.length
    unit = rod.density * 9.81 * rod.length**2

    def change(world: World, size: float) -> World:
        return replace(world, law=Law(size / span, span, np.inf, fresh=False, dahl=True))

    concealed = Concealed(
        "bending_hysteresis", "physics", change, 1e-4 * unit, 1e-2 * unit, "moment", "N m"
    )
    return Drawn(concealed, "Dahl", lambda size: {"M0": size, "k0": span})


DRAWN = {
    "bending_law": bending, "axial_law": axial, "force_field": force_field,
    "follower_force": follower, "bending_hysteresis": hysteresis,
}  # fmt: skip
