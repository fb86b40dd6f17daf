# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
# The compiled module says nothing of what is in it, and is an extra.
"""Let an exported MuJoCo rope come to rest and write where it is. Runs with MuJoCo 3 or 4.

    python settle_mujoco.py ROPE.xml --pose POSE --out SHAPE.csv

SHAPE.csv gets a row a vertex: x,y,z [m], from end 0 to end 1. Imports nothing of ropefit, so that
it runs where only the simulator is installed, and lies apart from the exporters, whose file names
(mujoco, json) would hide the modules it needs.
"""

import argparse

import mujoco
import numpy as np

REST = 1e-5  # m/s, a rope slower than this is at rest
DRAG = 8.0  # 1/s on every velocity: near critical for the slowest swing of a 1 m rope
LONGEST = 60.0  # s of simulated time


def vertices(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    """Return (V, 3) [m] of the flex named rope, or of the sites of a cable."""
    if model.nflex:
        return data.flexvert_xpos[: model.flex_vertnum[0]].copy()
    names = [
        mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_SITE, i) or "" for i in range(model.nsite)
    ]
    found = {int(n[7:]): data.site_xpos[i] for i, n in enumerate(names) if n.startswith("vertex_")}
    return np.array([found[i] for i in sorted(found)])


def settle(path: str, pose: int) -> tuple[np.ndarray, float]:
    """Return vertices at rest, and the time [s] that took."""
    model = mujoco.MjModel.from_xml_path(path)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, pose)
    calm = 0
    while data.time < LONGEST:
        before = vertices(model, data)
        data.qvel *= np.exp(-DRAG * model.opt.timestep)
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        if model.nflex:
            mujoco.mj_flex(model, data)
        speed = np.abs(vertices(model, data) - before).max() / model.opt.timestep
        # At the turning point of a swing the rope is slow too.
        calm = calm + 1 if speed < REST else 0
        if calm > 200:
            return vertices(model, data), data.time
    raise SystemExit(f"{path}: still moves at {speed:.2e} m/s after {LONGEST:g} s")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("rope")
    parser.add_argument("--pose", type=int, default=0)
    parser.add_argument("--out", required=True, help="csv of the vertices at rest: x,y,z")
    options = parser.parse_args()
    shape, time = settle(options.rope, options.pose)
    np.savetxt(options.out, shape, delimiter=",", header="x,y,z", comments="")
    print(f"at rest after {time:.2f} s")
