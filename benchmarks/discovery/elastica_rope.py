"""PyElastica's rope at rest in given poses, in a Python that has it (`pip install pyelastica`)."""

from __future__ import annotations

import subprocess
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reference_simulators.kirchhoff_rod import CLAMPED, Ends
from reference_simulators.rod_equations import Rod, rotation

Array = NDArray[np.float64]
ELEMENTS = 40
STIFF = 2000.0  # EA and GA over the weight: its steps are explicit, so nothing is inextensible
LONGEST = 3600  # s

# One rope that is led from pose to pose and comes to rest in each. Its clamps hold the direction of
# a whole element, which straddles the clamping point: no part of the rope is kept from bending.
SCRIPT = """
import sys
import elastica as ea, numpy as np
told = np.load(sys.argv[1])
count, length, density, bend, twist = int(told["count"]), *told["rope"]
gravity, ends, ways, clamped = told["gravity"], told["ends"], told["ways"], bool(told["clamped"])
class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping): pass
simulator, weight = Simulator(), density * length * np.linalg.norm(gravity)
edge = length / (count - clamped)
radius, start, way = 0.004, ends[0, 1], ways[0, 1] if clamped else ends[0, 1] - ends[0, 0]
way = way / np.linalg.norm(way)
across = np.cross(way, [0.0, 0, 1.0] if abs(way[2]) < 0.9 else [1.0, 0, 0])
rod = ea.CosseratRod.straight_rod(count, start - (length + 0.5 * clamped * edge) * way, way,
    across / np.linalg.norm(across), count * edge, radius, density / (np.pi * radius**2),
    youngs_modulus=bend / (np.pi * radius**4 / 4))
stiff = float(told["stiff"]) * weight
rod.shear_matrix[:] = 0
rod.bend_matrix[:] = 0
for i in range(3):
    rod.shear_matrix[i, i] = stiff
    rod.bend_matrix[i, i] = twist if i == 2 else bend
# Thin elements would turn faster than the time step: they get more rotary inertia.
heavy = density * edge**3 / 4
rod.mass_second_moment_of_inertia[:] = np.eye(3)[..., None] * heavy
rod.inv_mass_second_moment_of_inertia[:] = np.eye(3)[..., None] / heavy
simulator.append(rod)
now = {"place": start - length * way, "way": way}
half = 0.5 * edge
last_way = way.copy()
class Held(ea.ConstraintBase):
    def constrain_values(self, system, time):
        x = system.position_collection
        if clamped:
            x[:, 0], x[:, 1] = now["place"] - half * now["way"], now["place"] + half * now["way"]
            x[:, -2], x[:, -1] = start - half * last_way, start + half * last_way
            for k, tangent in ((0, now["way"]), (-1, last_way)):
                q = system.director_collection[..., k]
                side = q[0] - (q[0] @ tangent) * tangent
                side /= np.linalg.norm(side)
                q[0], q[1], q[2] = side, np.cross(tangent, side), tangent
        else:
            x[:, 0], x[:, -1] = now["place"], start
    def constrain_rates(self, system, time):
        held = [0, 1, -2, -1] if clamped else [0, -1]
        system.velocity_collection[:, held] = 0.0
        if clamped:
            system.omega_collection[:, [0, -1]] = 0.0
simulator.constrain(rod).using(Held)
simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=gravity)
step = 0.2 * edge / np.sqrt(stiff / density)
simulator.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=8.0, time_step=step)
simulator.finalize()
stepper, time, shapes = ea.PositionVerlet(), 0.0, []
def lead(pose, seconds):
    global time, start, last_way
    old = dict(now)
    for k in range(1, int(seconds / step) + 1):
        part = k / int(seconds / step)
        part = part * part * (3 - 2 * part)
        now["place"] = (1 - part) * old["place"] + part * ends[pose, 0]
        if clamped:
            between = (1 - part) * old["way"] + part * ways[pose, 0]
            now["way"] = between / np.linalg.norm(between)
        time = stepper.step(simulator, time, step)
for pose in range(len(ends)):
    start, last_way = ends[pose, 1], ways[pose, 1] if clamped else last_way
    lead(pose, 1.5 if pose == 0 else 0.5)
    calm, waited = 0, 0.0
    while calm < 5:
        before = rod.position_collection.copy()
        for _ in range(int(0.02 / step)):
            time = stepper.step(simulator, time, step)
        waited += 0.02
        moved = np.abs(rod.position_collection - before).max() / 0.02
        calm = calm + 1 if moved < 1e-4 else 0  # slow too where a swing turns back
        if waited > 20 or not np.isfinite(moved):
            sys.exit(f"pose {pose}: still moves at {moved:.2e} m/s")
    shapes.append(rod.position_collection.T.copy())
np.save(sys.argv[2], np.array(shapes))
"""


def run_script(python: Path, script: str, **told: Any) -> Array:
    """Return the array that a script saves, from what it is told, by a Python that has PyElastica.

    Raises RuntimeError with the last line of what went wrong.
    """
    with tempfile.TemporaryDirectory() as name:
        given, out = Path(name) / "told.npz", Path(name) / "found.npy"
        np.savez(given, **told)
        command = [str(python), "-c", script, str(given), str(out)]
        run = subprocess.run(command, capture_output=True, text=True, timeout=LONGEST)
        if run.returncode:
            raise RuntimeError((run.stderr.strip().splitlines() or ["no output"])[-1])
        return np.load(out)


def between_clamps(x: Array, length: float, clamped: bool) -> tuple[Array, Array]:
    """Return arc lengths (n,) [m] and centrelines (..., n, 3) [m] of a rope from its vertices x.

    The outer vertices of clamped elements are no part of it. length [m]: of the rope.
    """
    if not clamped:
        return np.linspace(0.0, length, x.shape[-2]), x
    middle = 0.5 * (x[..., [0, -2], :] + x[..., [1, -1], :])
    x = np.concatenate([middle[..., :1, :], x[..., 1:-1, :], middle[..., 1:, :]], axis=-2)
    half = 0.5 * length / (x.shape[-2] - 2)
    inner = np.linspace(half, length - half, x.shape[-2] - 2)
    return np.concatenate([[0.0], inner, [length]]), x


def shapes(python: Path, rod: Rod, held: Ends) -> tuple[Array, Array]:
    """Return arc lengths (n,) [m] and centrelines (T, n, 3) [m] of all frames, each at rest.

    Raises RuntimeError with the last line of what went wrong.
    """
    clamped = held.kinds[0] == CLAMPED
    x = run_script(
        python, SCRIPT, count=ELEMENTS + clamped, gravity=np.array(rod.gravity), stiff=STIFF,
        rope=[rod.length, rod.density, rod.bending, rod.torsion], ends=held.positions,
        ways=rotation(held.orientations)[..., 2], clamped=clamped,
    )  # fmt: skip
    return between_clamps(x, rod.length, clamped)
