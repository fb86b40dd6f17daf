"""A film of a rope by one camera, rendered from another simulator's shapes: EI from pixels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw, ImageFilter
from scipy.interpolate import CubicSpline

import ropefit
from reference_simulators.kirchhoff_rod import PINNED, Ends, hang
from reference_simulators.rod_equations import Point, Rod
from ropefit.errors import BadInput, WrongUsage
from ropefit.importers.video import stillest
from ropefit.recordings import open_recording
from ropefit.recordings.writer import About
from ropefit.stages.importing import import_recording

av = pytest.importorskip("av")

EI, DENSITY, LENGTH, RADIUS = 2e-3, 0.05, 0.9, 0.004  # N m², kg/m, m, m
EYE, FOCAL, SIZE = np.array([0.3, -1.1, -0.15]), 900.0, (960, 720)
POSE = "0.3,-1.1,-0.15,-0.70710678,0,0,0.70710678"  # looks along +y
WEIGHT = Point(0.4, mass=0.012)
POSES, STILL, MOVING = 8, 6, 3  # frames at rest in each pose, and on the way to the next


def shapes(weights: tuple[Point, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Ends (P, 2, 3) and ropes (P, 400, 3) [m]."""
    across, up = np.linspace(0.35, 0.75, POSES), np.array([0, 0.1, -0.1, 0.15, 0, -0.05, 0.2, 0.05])
    ends = np.zeros((POSES, 2, 3))
    ends[:, 1] = np.stack([across, 0.05 * np.sin(np.arange(POSES)), up], axis=1)
    held = Ends(ends, np.tile([1.0, 0, 0, 0], (POSES, 2, 1)), (PINNED, PINNED))
    rod = Rod(LENGTH, DENSITY, EI, EI, points=weights)
    solved, y = hang(rod, held, breaks=rod.breaks)
    mesh, first = np.unique(solved.mesh, return_index=True)
    return ends, CubicSpline(mesh, y[:, first, :3], axis=1)(np.linspace(0, LENGTH, 400))


def picture(line: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """(H, W, 3) uint8: a red rope before a mottled wall, as the camera sees it."""
    x, y, z = (line - EYE).T
    u, v = FOCAL * x / y + 0.5 * (SIZE[0] - 1), -FOCAL * z / y + 0.5 * (SIZE[1] - 1)
    canvas = Image.new("RGB", (2 * SIZE[0], 2 * SIZE[1]), (150, 150, 145))
    places = list(zip(2 * u + 0.5, 2 * v + 0.5, strict=True))
    draw, wide = ImageDraw.Draw(canvas), 4 * RADIUS * FOCAL / y.mean()
    draw.line(places, fill=(190, 40, 30), width=round(wide), joint="curve")
    small = canvas.resize(SIZE, Image.Resampling.BOX).filter(ImageFilter.GaussianBlur(0.6))
    noise = rng.normal(0, 3, (*SIZE[::-1], 3))
    return np.clip(np.asarray(small) + noise, 0, 255).astype(np.uint8)


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return filmed(tmp_path_factory.mktemp("film"))


def filmed(folder: Path, *weights: Point) -> Path:
    """clip.mp4 and its ends.csv."""
    rng, (ends, ropes) = np.random.default_rng(5), shapes(weights)
    rows, number = ["frame,end,x,y,z"], 0
    with av.open(str(folder / "clip.mp4"), "w") as file:
        stream = file.add_stream("libx264", rate=10)
        stream.width, stream.height, stream.pix_fmt = *SIZE, "yuv420p"
        stream.options = {"crf": "16"}
        for pose in range(POSES):
            after = min(pose + 1, POSES - 1)
            for part in [0.0] * STILL + list(np.arange(1, MOVING + 1) / (MOVING + 1)):
                line = (1 - part) * ropes[pose] + part * ropes[after]
                held = (1 - part) * ends[pose] + part * ends[after]
                frame = av.VideoFrame.from_ndarray(picture(line, rng), format="rgb24")
                file.mux(stream.encode(frame))
                for end, place in enumerate(held + rng.normal(0, 0.0005, (2, 3))):
                    rows.append(f"{number},{end}," + ",".join(f"{v:.6f}" for v in place))
                number += 1
        file.mux(stream.encode(None))
    (folder / "ends.csv").write_text("\n".join(rows) + "\n")
    return folder / "clip.mp4"


def imported(clip: Path, out: Path, **given: str) -> Path:
    given = {"frames": str(POSES), "fov": f"{np.degrees(2 * np.arctan(SIZE[0] / 2 / FOCAL)):.6f}",
             "ends": str(clip.parent / "ends.csv"), "camera_pose": POSE} | given  # fmt: skip
    known = About("film", length=LENGTH, diameter=2 * RADIUS, mass=DENSITY * LENGTH)
    import_recording(clip, "video", out, {k: v for k, v in given.items() if v}, known)
    return out


def test_still_frames_are_taken_of_every_pose(clip: Path, tmp_path: Path) -> None:
    recording = open_recording(imported(clip, tmp_path / "r"))
    one = STILL + MOVING
    assert len(recording.frames) == POSES
    assert {frame // one for frame in recording.frames} == set(range(POSES))
    assert all(frame % one < STILL for frame in recording.frames[:-1])
    assert recording.times(recording.frames) is None


def test_rigidity_from_one_camera(clip: Path, tmp_path: Path) -> None:
    o = ropefit.preprocess(imported(clip, tmp_path / "r"))
    assert len(o.frames) == POSES
    model = ropefit.fit(o, solver="equilibrium", free=["EI"]).nominal
    found = next(iter(model.groups.values())).parameters["EI"]
    print(found)
    assert found.ci95 is not None
    low, high = found.ci95
    assert low < EI < high
    assert high < 2 * low


def test_a_weight_is_found_by_one_camera(tmp_path: Path) -> None:
    o = ropefit.preprocess(imported(filmed(tmp_path, WEIGHT), tmp_path / "r"))
    found = ropefit.diagnose(o, ropefit.fit(o, solver="equilibrium", free=["EI"]))
    assert found.verdict == "found"
    (cause,) = found.causes.values()
    told = dict(zip(cause.value_names, cause.values, strict=True))
    assert told["mass"] == pytest.approx(WEIGHT.mass, rel=0.05)
    assert told["arc_length"] == pytest.approx(WEIGHT.at, abs=0.01)


def test_what_pictures_alone_do_not_tell_is_refused(clip: Path, tmp_path: Path) -> None:
    o = ropefit.preprocess(imported(clip, tmp_path / "r"))
    with pytest.raises(BadInput, match="poses of both ends"):
        ropefit.fit(o.model_copy(update={"ends_assumed": True}), solver="equilibrium")
    with pytest.raises(WrongUsage, match="focal length"):
        imported(clip, tmp_path / "other", fov="")


def test_a_film_in_which_nothing_moves_gives_frames_all_along() -> None:
    still = np.random.default_rng(2).normal(100, 1, (40, 20, 30))
    taken = stillest(still, 4)
    assert len(taken) == 4
    assert np.ptp(taken) > 15
