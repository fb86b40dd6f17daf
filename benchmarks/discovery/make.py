"""One case: what is concealed, how large, and what the rope then looks like."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from benchmarks.discovery.concealed import HISTORY_DEPENDENT, NEEDS_CLAMPS, NEEDS_PINS, PHYSICS
from benchmarks.discovery.concealed_errors import MEASUREMENT, UNKNOWN
from benchmarks.discovery.concealment import Concealed
from benchmarks.discovery.following import followed
from benchmarks.discovery.made import Made, Sized
from benchmarks.discovery.setting import Setting, World, draw, grasped, miscalibrated
from benchmarks.discovery.strength import Meter, meter, seen_change, shapes
from reference_simulators.collocation import NotConverged, solve
from reference_simulators.kirchhoff_rod import CLAMPED, follow, hang, problem
from reference_simulators.rod_equations import Array, rotation

CATALOGUE = PHYSICS | HISTORY_DEPENDENT | MEASUREMENT | UNKNOWN

DEEPEST = 0.25  # of a bar's radius, that a rope sinks in: beyond, it is on its way through
LEAST_BESIDE = 6.0  # score of an effect beside the others: below, it is hardly in the recording


class Implausible(RuntimeError):
    """The wanted score needs a size that no rope has."""


def moved_frames(setting: Setting, states: Array) -> list[int]:
    """Return the frames whose shape (of T, N + 1, 13) differs from the setting's."""
    change = np.linalg.norm(states[..., :3] - setting.states[..., :3], axis=-1).max(axis=1)
    return np.flatnonzero(change > 1e-4).tolist()


def at_score(
    setting: Setting, scale: Meter, effect: Concealed, wanted: float
) -> tuple[Sized, Array]:
    """Find the size whose score is `wanted`, within a tenth; return it and the states there."""
    size, tried = min(effect.start, effect.most), []
    start = None
    for _ in range(8):
        world = effect.change(setting.world, size)
        try:
            goal, states = shapes(setting, world, start)
        except (NotConverged, np.linalg.LinAlgError):
            if start is not None:
                start = None
                continue
            size *= 0.3
            continue
        if goal.mesh is not setting.problem.mesh:
            raise AssertionError("the mesh must not change")
        if world.law is None and len(moved_frames(setting, states)) == len(states):
            states = followed(goal, setting.states, states)
        score = scale.score(seen_change(setting, scale, world, states))
        tried.append((size, score))
        if abs(np.log(max(score, 1e-9) / wanted)) < 0.1:
            return Sized(effect, size, score, moved_frames(setting, states)), states
        # A power law through the last two sizes; proportional at first.
        power = 1.0
        if len(tried) > 1 and tried[-1][0] != tried[-2][0]:
            (a, p), (b, q) = tried[-2:]
            power = np.clip(np.log(max(q, 1e-6) / max(p, 1e-6)) / np.log(b / a), 0.3, 3.0)
        factor = float(np.clip((wanted / max(score, 1e-6)) ** (1 / power), 0.1, 6.0))
        if size >= effect.most and factor > 1:
            raise Implausible(f"{effect.name}: {effect.most:.3g} {effect.unit} scores {score:.1f}")
        start = states if effect.follows else None
        size = min(size * factor, effect.most)
    raise Implausible(f"{effect.name}: no size found for a score of {wanted}")


def as_drawn(
    setting: Setting, scale: Meter, effect: Concealed, factor: float
) -> tuple[Sized, Array]:
    """Apply a measurement error at a usual size: its prior explains it, so no score is asked."""
    size = min(factor * effect.start, effect.most)
    world = effect.change(setting.world, size)
    _, states = shapes(setting, world)
    score = scale.score(seen_change(setting, scale, world, states))
    frames = list(range(len(states)))
    return Sized(effect, size, score, frames), states


def breaks_of(effects: list[Concealed]) -> list[float]:
    """Return arc lengths [m] that the mesh must have."""
    return [s for effect in effects if effect.place for s in effect.place]


def with_mesh(setting: Setting, effects: list[Concealed]) -> Setting:
    """Solve the setting on a mesh that resolves where the effects act."""
    places = breaks_of(effects)
    kinds, held = setting.held.kinds, setting.held
    rolling, states = hang(setting.rod, setting.held, breaks=places)
    if kinds[0] == CLAMPED:
        fixed = problem(setting.rod, setting.held, breaks=places)
        # Same frames as the setting's own: solve with the clamps as they were recorded.
        sign = np.sign((states[:, -1, 3:7] * setting.held.orientations[:, 1]).sum(-1))
        states[..., 3:7] *= sign[:, None, None]
        states = solve(replace(fixed, mesh=rolling.mesh), states)
    else:
        held = grasped(held, states)
    new = replace(rolling, rod=setting.rod, held=held, gauge=kinds[0] != CLAMPED)
    return replace(setting, held=held, problem=new, states=states)


def stretching(setting: Setting, strain: float) -> Setting:
    """Return the setting with a rope that stretches by this much under its own weight."""
    weight = setting.rod.density * setting.rod.length * 9.81
    rod = replace(setting.rod, compliance=strain / weight)
    goal = replace(setting.problem, rod=rod)
    return replace(setting, rod=rod, problem=goal, states=follow(lambda _: goal, setting.states))


def _all_seen(setting: Setting, scale: Meter, sized: list[Sized]) -> None:
    """Refuse effects of which one hides beside the others: a load may lift a rope off a bar."""

    def seen(without: Sized | None) -> Array:
        world = setting.world
        for one in sized:
            world = world if one is without else one.effect.change(world, one.size)
        return seen_change(setting, scale, world, shapes(setting, world)[1])

    together = seen(None)
    for one in sized:
        least = min(LEAST_BESIDE, 0.5 * one.score)
        if scale.score(together - seen(one)) < least:
            raise Implausible(f"{one.effect.name}: hardly seen beside the other effects")


def outside_of_bars(world: World, states: Array) -> None:
    """Refuse shapes (T, N + 1, 13) that pass through a bar: no rope stays in such a one."""
    for field in world.rod.fields:
        solid = field.kind == "bar" and not (field.soft or field.power or field.filled)
        if solid and field.distance(states[..., :3])[0].min() < (1 - DEEPEST) * field.reach:
            raise Implausible("the rope passes through the bar")


def make(
    effects: list[str],
    scores: list[float],
    seed: int,
    clamped: bool | None = None,
    calibration: bool = False,
    simulator: str = "elastica",
    stretch: float = 0.0,
) -> Made:
    """Draw a setting and effects of these scores; solve it. stretch: the strain under its own
    weight of the rope to which the effects are added."""
    rng = np.random.default_rng(seed)
    if clamped is None:
        clamped = bool(rng.random() < 0.5)
    clamped = (clamped or bool(NEEDS_CLAMPS & set(effects))) and not NEEDS_PINS & set(effects)
    setting = draw(clamped, rng, back=bool(HISTORY_DEPENDENT.keys() & set(effects)))
    if stretch:
        setting = stretching(setting, stretch)
    chosen = [CATALOGUE[effect](setting, rng) for effect in effects]
    if breaks_of(chosen):
        setting = with_mesh(setting, chosen)
    world, sized, states = setting.world, [], setting.states
    if chosen:
        scale = meter(setting)
    for effect, score in zip(chosen, scores, strict=True):
        if effect.kind == "measurement":
            found, states = as_drawn(setting, scale, effect, float(rng.uniform(0.8, 2.0)))
        else:
            found, states = at_score(setting, scale, effect, score)
        sized.append(found)
        world = effect.change(world, found.size)
    if len(sized) > 1:
        _all_seen(setting, scale, sized)
    if calibration:
        world = miscalibrated(world, rng)
    if simulator == "mujoco":
        from reference_simulators import mujoco_rope

        s, nodes = mujoco_rope.shapes(world.rod, world.held, setting.diameter)
        return Made(setting, world, sized, s, nodes, mujoco_rope.tangents(s, nodes), simulator)
    goal, states = shapes(setting, world, states)
    if world.law is None and all(len(one.frames) == len(states) for one in sized):
        states = followed(goal, setting.states, states)
    outside_of_bars(world, states)
    direction = rotation(states[..., 3:7])[..., 2]
    tension = (states[..., 7:10] * direction).sum(-1, keepdims=True)
    tangents = (1 + world.rod.strain(tension)[0]) * direction
    return Made(setting, world, sized, goal.mesh, states[..., :3], tangents, simulator)
