"""PyElastica's rope in motion, filmed, in a Python that has it (`pip install pyelastica`)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.discovery.elastica_rope import between_clamps, run_script
from benchmarks.discovery.setting import World
from reference_simulators.kirchhoff_rod import CLAMPED
from reference_simulators.rod_equations import Array, rotation

ELEMENTS = 60
STRETCH, SHEAR = 20_000.0, 5_000.0  # EA and GA over the weight: its steps are explicit
GYRATION = 0.003  # m, of the cross-section: less, and elements turn faster than a time step
PART = 0.4  # of the time in which a wave runs along an element: a step
SAMPLE = 0.001  # s between the told poses, linear in between
CALM, LED = 1.5, 1.0  # s to come to rest in a first pose, and on the way there
DAMPED = 8.0  # 1/s, meanwhile; of spin always: its inertia is a hundredth of a per cent

# Clamps hold the frame of a whole element, which straddles the clamping point: no part of the rope
# is kept from bending. Both ends are led from a straight rope without twist.
SCRIPT = """
import sys
import elastica as ea, numpy as np
from scipy.spatial.transform import Rotation, Slerp
told = np.load(sys.argv[1])
count, length, density, bend, twist = int(told["count"]), *told["rope"]
gravity, clamped, drag = told["gravity"], bool(told["clamped"]), float(told["drag"])
places, turns, sample = told["places"], told["turns"], float(told["sample"])
film, step_of_film = int(told["film"]), float(told["step_of_film"])
stretch, shear, gyration, part = told["limits"]
calm, led, damped = told["calm"]
class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping): pass
simulator, weight = Simulator(), density * length * np.linalg.norm(gravity)
edge = length / (count - clamped)
half, radius = 0.5 * edge, 0.004
last, last_turns = told["last"], np.swapaxes(told["last_turns"], 1, 2)
now = {"last": last_turns[0], "drag": damped}
way = now["last"][2]
rod = ea.CosseratRod.straight_rod(count, last - (length + clamped * half) * way, way,
    now["last"][0], count * edge, radius, density / (np.pi * radius**2),
    youngs_modulus=bend / (np.pi * radius**4 / 4))
at = edge * np.arange(count + 1) - clamped * half
rod.shear_matrix[:], rod.bend_matrix[:] = 0, 0
factor = np.ones(count - 1)
for begin, end, times, _ in told["sections"]:
    factor[(at[1:-1] >= begin) & (at[1:-1] < end)] *= times
for i in range(3):
    rod.shear_matrix[i, i] = (stretch if i == 2 else shear) * weight
    rod.bend_matrix[i, i] = (twist if i == 2 else bend) * factor
def within(low, high, begin, end):
    return np.maximum(np.minimum(high, end) - np.maximum(low, begin), 0.0)
low, high = at - half, at + half
mass = density * within(low, high, 0.0, length)
for begin, end, _, times in told["sections"]:
    mass += density * (times - 1) * within(low, high, max(begin, 0.0), min(end, length))
for place, more in told["points"]:
    right = int(np.clip(np.searchsorted(at, place), 1, count))
    share = (place - at[right - 1]) / edge
    mass[right - 1] += (1 - share) * more
    mass[right] += share * more
rod.mass[:] = np.maximum(mass, 1e-6)
inertia = density * edge * gyration**2
rod.mass_second_moment_of_inertia[:] = np.eye(3)[..., None] * inertia
rod.inv_mass_second_moment_of_inertia[:] = np.eye(3)[..., None] / inertia
simulator.append(rod)
now |= {"place": last - length * way, "frame": now["last"]}
class Held(ea.ConstraintBase):
    def constrain_values(self, system, time):
        x = system.position_collection
        if not clamped:
            x[:, 0], x[:, -1] = now["place"], last
            return
        for node, edge_, place, name in ((0, 0, now["place"], "frame"), (-2, -1, last, "last")):
            q = now[name]
            x[:, node], x[:, node + 1] = place - half * q[2], place + half * q[2]
            system.director_collection[..., edge_] = q
    def constrain_rates(self, system, time):
        system.velocity_collection[:, [0, 1, -2, -1] if clamped else [0, -1]] = 0.0
        if clamped:
            system.omega_collection[:, [0, -1]] = 0.0
class Drag(ea.DamperBase):
    def dampen_rates(self, system, time):
        system.velocity_collection *= np.exp(-now["drag"] * step)
        system.omega_collection *= calming
simulator.constrain(rod).using(Held)
simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=gravity)
step = part * edge / np.sqrt(stretch * weight / density)
calming = np.exp(-damped * step)
simulator.dampen(rod).using(Drag)
simulator.finalize()
stepper, films = ea.PositionVerlet(), []
def turned(old, new):
    return Slerp([0, 1], Rotation.from_matrix(np.stack([old.T, new.T])))
def lead(place, frame, last_frame):
    old, steps = dict(now), int(led / step)
    path, last_path = turned(old["frame"], frame), turned(old["last"], last_frame)
    for k in range(1, steps + int(calm / step)):
        way = min(k / steps, 1.0)
        way = way * way * (3 - 2 * way)
        if k <= steps:
            now["place"] = (1 - way) * old["place"] + way * place
            now["frame"], now["last"] = path(way).as_matrix().T, last_path(way).as_matrix().T
        stepper.step(simulator, 0.0, step)
    if clamped and np.abs((rod.kappa[2] * edge).sum()) > 1:
        sys.exit("the rope is twisted where it begins")
for clip in range(len(places)):
    now["drag"] = damped
    frames = np.swapaxes(turns[clip], 1, 2)
    lead(places[clip, 0], frames[0], last_turns[clip])
    now["drag"] = drag
    shapes, done = [], 0
    while len(shapes) < film:
        if done * step >= len(shapes) * step_of_film - 0.5 * step:
            shapes.append(rod.position_collection.T.copy())
        k = min(int((done + 1) * step / sample), len(places[clip]) - 2)
        share = (done + 1) * step / sample - k
        now["place"] = (1 - share) * places[clip, k] + share * places[clip, k + 1]
        if clamped:
            q = (1 - share) * frames[k] + share * frames[k + 1]
            q[2] /= np.linalg.norm(q[2])
            q[0] -= (q[0] @ q[2]) * q[2]
            q[0] /= np.linalg.norm(q[0])
            q[1] = np.cross(q[2], q[0])
            now["frame"] = q
        stepper.step(simulator, 0.0, step)
        done += 1
    if not np.isfinite(shapes[-1]).all():
        sys.exit(f"clip {clip}: diverged")
    films.append(shapes)
np.save(sys.argv[2], np.array(films))
"""


def filmed(
    python: Path, world: World, places: Array, turns: Array, last_turns: Array, times: Array,
    drag: float,
) -> tuple[Array, Array]:  # fmt: skip
    """Return arc lengths (n,) [m] and centrelines (C, T, n, 3) [m] of C clips at times (T,) [s].

    places (C, S, 3) [m], turns (C, S, 4): end 0, every `SAMPLE` from time 0, at which the rope
    rests; last_turns (C, 4): end 1, which stays in a clip (turns of pinned ends say nothing); drag
    [1/s]: force against the velocity, per mass. Raises RuntimeError with the last line of what went
    wrong.
    """
    rod, clamped = world.rod, world.held.kinds[0] == CLAMPED
    x = run_script(
        python, SCRIPT, count=ELEMENTS + clamped, gravity=np.array(rod.gravity), clamped=clamped,
        rope=[rod.length, rod.density, rod.bending, rod.torsion], drag=drag, sample=SAMPLE,
        places=places, turns=rotation(turns), last=world.held.positions[0, 1],
        last_turns=rotation(last_turns), film=len(times), step_of_film=times[1] - times[0],
        limits=[STRETCH, SHEAR, GYRATION, PART], calm=[CALM, LED, DAMPED],
        sections=np.array(
            [(p.start, p.end, p.bending, p.density) for p in rod.sections]
        ).reshape(-1, 4),
        points=np.array([(p.at, p.mass) for p in rod.points]).reshape(-1, 2),
    )  # fmt: skip
    return between_clamps(x, rod.length, clamped)
