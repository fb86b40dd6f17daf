"""Make the packaged sample recordings anew.

    python sample_data/generate.py [--only rgbd|cloud|markers]

Needs ``mujoco-core>=4.0.1`` (``pip install ropefit[samples]``). Same seed, same data.
"""

import argparse
from collections.abc import Callable
from pathlib import Path

import numpy as np
from generator.clouds import write_clouds
from generator.images import write_images
from generator.markers import write_markers
from generator.motions import out_and_back, swept_poses, swung_clamp
from generator.recording import (
    Truth,
    settle_all,
    start_folder,
    write_ends,
    write_toml,
    write_truth,
)
from generator.rope import EndPoses, Rope

ROOT = Path(__file__).resolve().parent
SEED = 20261106

# SI units: m, m, kg, N·m²
SOFT_ROPE = Rope(length=1.0, diameter=0.008, mass=0.05, bending_rigidity=7e-4)
STIFF_ROPE = Rope(length=1.0, diameter=0.008, mass=0.05, bending_rigidity=2e-3)

Motion = Callable[[int, float], list[EndPoses]]
Sensor = Callable[[Path, Truth, np.random.Generator], str]

RECORDINGS: dict[str, tuple[Rope, Motion, int, Sensor]] = {
    "cloud": (SOFT_ROPE, out_and_back, 36, write_clouds),
    "rgbd": (SOFT_ROPE, swept_poses, 8, write_images),
    "markers": (STIFF_ROPE, swung_clamp, 40, write_markers),
}


def make(kind: str) -> None:
    """Simulate one recording and write its folder."""
    print(kind)
    rope, motion, frames, write_sensor = RECORDINGS[kind]
    truth = settle_all(rope, motion(frames, rope.length))
    rng = np.random.default_rng([SEED, list(RECORDINGS).index(kind)])
    folder = ROOT / kind
    start_folder(folder)
    write_truth(folder, truth)
    write_ends(folder, truth, rng)
    write_toml(folder, rope, f"sample-{kind}", write_sensor(folder, truth, rng))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description="Make the packaged sample recordings anew.")
    parser.add_argument("--only", choices=sorted(RECORDINGS), help="make one recording only")
    only = parser.parse_args().only
    for kind in RECORDINGS if only is None else [only]:
        make(kind)


if __name__ == "__main__":
    main()
