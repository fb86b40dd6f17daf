"""The same hanging ropes in other simulators, brought to rest by their own dynamics.

A derivative in six parameters by central differences takes thirteen states a frame; one frame is
timed and the rest is multiplied, which the table says.
"""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path

import numpy as np

STATES = 13  # one, and two for each of six parameters
APART = 0.65  # m, of the frame that is timed


def mujoco(edges: int) -> float:
    """Time [s] one frame: from straight to rest, then twelve times to rest from a neighbour.

    Raises ImportError without `mujoco-core` (pip install 'ropefit[samples]').
    """
    from sample_data.generator.rope import EndPoses, Rope, SettledRope

    def pose(apart: float) -> EndPoses:
        return EndPoses(np.array([[0.0, 0.0, 0.0], [apart, 0.0, 0.0]]))

    rope = Rope(length=1.0, diameter=0.008, mass=1.0, bending_rigidity=2e-4 * 9.81)
    start = time.perf_counter()
    settled = SettledRope(rope, pose(APART), edges)
    first = time.perf_counter() - start
    start = time.perf_counter()
    settled.settle(pose(APART + 1e-3), move_time=0.05)
    return first + (STATES - 1) * (time.perf_counter() - start)


# Run by a Python that has PyElastica; prints the seconds of one state and how fast it still moves.
ELASTICA = """
import json, sys, time
import elastica as ea, numpy as np
segments, apart, bend = int(sys.argv[1]), float(sys.argv[2]), float(sys.argv[3])
class Simulator(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping): pass
simulator = Simulator()
radius = 0.004
young = bend / (np.pi * radius**4 / 4)
rod = ea.CosseratRod.straight_rod(segments, np.zeros(3), np.array([1.0, 0, 0]),
    np.array([0, 0, 1.0]), 1.0, radius, 1.0 / (np.pi * radius**2), youngs_modulus=young)
rod.shear_matrix[:] = 0
for i in range(3):
    rod.shear_matrix[i, i] = 1e3
rod.mass_second_moment_of_inertia *= 30
rod.inv_mass_second_moment_of_inertia /= 30
simulator.append(rod)
class Ends(ea.ConstraintBase):
    def constrain_values(self, system, time):
        share = min(time / 1.0, 1.0)
        system.position_collection[:, 0] = 0.0
        system.position_collection[:, -1] = [1.0 + share * (apart - 1.0), 0.0, 0.0]
    def constrain_rates(self, system, time):
        system.velocity_collection[:, [0, -1]] = 0.0
simulator.constrain(rod).using(Ends)
simulator.add_forcing_to(rod).using(ea.GravityForces, acc_gravity=np.array([0, 0, -9.81]))
step = 0.1 / segments / np.sqrt(1e3)
simulator.dampen(rod).using(ea.AnalyticalLinearDamper, uniform_damping_constant=8.0, time_step=step)
simulator.finalize()
stepper = ea.PositionVerlet()
stepper.step(simulator, 0.0, step)  # compile
begin, now, chunk = time.perf_counter(), step, int(0.05 / step)
speed = 1.0
while now < 12.0 and (now < 1.5 or speed > 1e-5):
    for _ in range(chunk):
        now = stepper.step(simulator, now, step)
    speed = float(np.abs(rod.velocity_collection).max())
print(json.dumps({"seconds": time.perf_counter() - begin, "speed": speed,
                  "lowest": float(rod.position_collection[2].min())}))
"""


def pyelastica(python: Path, segments: int) -> dict[str, float]:
    """Bring one state to rest: return the seconds, the speed [m/s] left and the lowest point [m].

    Raises RuntimeError with the last line of what went wrong.
    """
    command = [str(python), "-c", ELASTICA, str(segments), str(APART), str(2e-4 * 9.81)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    if run.returncode:
        raise RuntimeError((run.stderr.strip().splitlines() or ["no output"])[-1])
    return json.loads(run.stdout.strip().splitlines()[-1])
