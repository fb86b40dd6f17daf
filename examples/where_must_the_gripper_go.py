"""Shape control: the gripper pose that brings a point of the rope to a wanted place.

    python examples/where_must_the_gripper_go.py [RUN]

With RUN the artifacts are kept there, and `ropefit report --run RUN` shows them.
"""

import sys

import numpy as np

import ropefit

observations = ropefit.preprocess(ropefit.sample("cloud"), nodes=12)
model = ropefit.fit(observations, most_frames=12)

middle = len(observations.node_arc) // 2
shape = observations.centreline[0, middle]  # where the rope's middle was in the first frame
wanted = shape + np.array([0.0, 0.0, 0.03])
found = ropefit.control(
    observations, model, targets=wanted[None], arc_length=observations.node_arc[[middle]]
)

print("the rope's middle is to rise by 30 mm")
print(f"gripper to {np.round(found.position[0], 4)} m, orientation {found.orientation[0].round(3)}")
print(f"it comes within {1e3 * found.key_deviation[0, 0]:.2f} mm; converged: {found.converged[0]}")

if len(sys.argv) > 1:
    ropefit.save(sys.argv[1], observations, model, found)
