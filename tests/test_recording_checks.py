"""What in a recording will mislead a fit is said with frame and size; markers that jump are
masked."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from ropefit.perception.jumps import jumps
from ropefit.perception.trace import FrameRejected
from ropefit.perception.tracing import Tracer
from ropefit.recordings import open_recording, sample_path
from tests.factories import rope_points, write_manifest

LENGTH = 1.0


def swaying(frames: int = 40, amplitude: float = 0.05) -> np.ndarray:
    """(F, 9, 3) [m] markers of a rope that sways and is carried to and fro."""
    phase = np.sin(np.arange(frames) / 6)
    shapes = np.stack([rope_points(0, 9) for _ in range(frames)])
    bow = np.sin(np.pi * np.linspace(0, 1, 9))
    shapes[:, :, 1] += amplitude * phase[:, None] * (1 + bow)
    return shapes


def recording(where: Path, positions: np.ndarray, ends: str = "markers = [[0], [-1]]", **arrays):
    where.mkdir()
    write_manifest(where, '[markers]\nfile = "m.npz"', f"length = {LENGTH}", ends)
    time = 0.02 * np.arange(len(positions))
    np.savez(where / "m.npz", positions=positions, time=time, **arrays)
    return open_recording(where)


def warnings(*words: str, of: Tracer) -> list[str]:
    return [text for text in of.warnings if all(word in text for word in words)]


@pytest.mark.parametrize("when", [slice(12, 13), slice(12, 25), slice(0, 1), slice(35, 40)])
@pytest.mark.parametrize("marker", [0, 4, 8])
def test_jumps_are_found_where_they_are(when: slice, marker: int) -> None:
    positions = swaying() + np.random.default_rng(3).normal(0, 5e-4, (40, 9, 3))
    positions[20, 6] = np.nan
    assert not jumps(positions).any()
    positions[when, marker] += [0.0, 0.05, 0.04]
    expected = np.zeros((40, 9), bool)
    expected[when, marker] = True
    np.testing.assert_array_equal(jumps(positions) > 0, expected)


def test_two_labels_that_change_places() -> None:
    positions = swaying()
    positions[15:19, [3, 4]] = positions[15:19, [4, 3]]
    found = jumps(positions)
    assert found[15:19, [3, 4]].all()
    assert (found > 0).sum() == 8


def test_nothing_jumps_from_clip_to_clip() -> None:
    wavy = swaying(30) + 0.1 * np.sin(2 * np.arange(9))[:, None]
    positions = np.concatenate([swaying(30), wavy])
    time = 0.02 * np.arange(60) + 10.0 * (np.arange(60) >= 30)
    assert jumps(positions).any()
    assert not jumps(positions, time).any()
    positions[35, 4] += [0.0, 0.05, 0.04]
    assert np.argwhere(jumps(positions, time)).tolist() == [[35, 4]]


def test_poses_one_after_the_other_do_not_jump() -> None:
    rng = np.random.default_rng(1)
    assert not jumps(swaying(12) + rng.normal(0, 0.05, (12, 1, 3)) * np.arange(9)[:, None]).any()
    poses = swaying(12) * rng.uniform(0.5, 1.5, (12, 1, 3))
    assert not jumps(poses).any()


def poses(seed: int = 2, count: int = 12) -> np.ndarray:
    """(F, 9, 3) [m] markers of a rope in poses far apart, each an arc of a circle of its own."""
    rng = np.random.default_rng(seed)
    made = []
    for radius in rng.uniform(0.3, 2.0, count):
        angle = np.linspace(-0.5, 0.5, 9) * LENGTH / radius
        flat = radius * np.stack([np.sin(angle), 1 - np.cos(angle), 0 * angle], axis=1)
        turn = np.linalg.qr(rng.standard_normal((3, 3)))[0]
        made.append(flat @ turn + rng.uniform(-0.2, 0.2, 3))
    return np.stack(made)


@pytest.mark.parametrize("marker", [0, 1, 4, 7, 8])
@pytest.mark.parametrize("hidden", [None, 3, 5])
def test_a_pose_with_a_wrong_label(marker: int, hidden: int | None) -> None:
    positions = poses() + np.random.default_rng(3).normal(0, 5e-4, (12, 9, 3))
    if hidden is not None:
        positions[:, hidden] = np.nan
    assert not jumps(positions).any()
    positions[6, marker] += [0.09, -0.08, 0.07]
    sizes = jumps(positions)
    assert np.argwhere(sizes).tolist() == [[6, marker]]
    assert sizes[6, marker] == pytest.approx(0.14, abs=0.05)


def test_two_wrong_labels_in_a_pose() -> None:
    positions = poses()
    positions[2, [2, 7], 0] += 0.15
    assert np.argwhere(jumps(positions)).tolist() == [[2, 2], [2, 7]]


def test_a_rope_bent_sharply_in_one_pose_does_not_jump() -> None:
    positions = poses()
    place = np.linspace(0, LENGTH, 9)
    for corner in (0.3, 0.5, 0.55):
        along = np.minimum(place, corner)
        positions[4] = np.stack([along, 0 * along, place - along], axis=1)  # a right angle
        assert not jumps(positions).any()


def test_a_pose_with_a_wrong_label_is_masked_and_said(tmp_path: Path) -> None:
    positions = poses()
    positions[6, 4, 1] += 0.12
    made = recording(tmp_path / "r", positions)
    np.savez(made.path / "m.npz", positions=positions)  # no times
    tracer = Tracer(open_recording(made.path))
    assert warnings("frame 6", "marker 4 jumps by", "masked in 1 frame", of=tracer)
    assert len(tracer.trace(6).points) == 8
    assert len(tracer.trace(7).points) == 9


def test_jumps_are_masked_and_said(tmp_path: Path) -> None:
    positions = swaying()
    positions[12, 4, 2] += 0.2
    positions[20, 0, 1] -= 0.1
    tracer = Tracer(recording(tmp_path / "r", positions))
    (text,) = warnings("frame 12", "marker 4 jumps by", "masked in 1 frame", of=tracer)
    assert "200 mm" in text or "201 mm" in text
    assert len(tracer.trace(12).points) == 8
    assert len(tracer.trace(13).points) == 9
    with pytest.raises(FrameRejected, match="held at end 0 jumps"):
        tracer.trace(20)


def test_ends_farther_apart_than_the_rope(tmp_path: Path) -> None:
    reach = 1.009 - 0.002 * np.abs(np.arange(20) - 7)
    line = np.linspace([0, 0, 0], [1.0, 0, 0], 9)
    positions = reach[:, None, None] * line
    tracer = Tracer(recording(tmp_path / "r", positions))
    (text,) = warnings("frame 7", "9.0 mm more than the rope is long", of=tracer)
    assert "stretch" in text
    assert not warnings("the ends are", of=Tracer(recording(tmp_path / "s", swaying())))


def test_markers_farther_apart_than_their_arc(tmp_path: Path) -> None:
    positions = swaying()
    chords = np.linalg.norm(np.diff(positions, axis=1), axis=2).max(axis=0)
    arc = np.r_[0.0, np.cumsum(chords)] + 1e-3 * np.arange(9)
    length = arc[-1]
    fine = recording(tmp_path / "r", positions, arc_length=arc * 0.99 / length)
    short = arc - 0.006 * (np.arange(9) > 5)
    bad = recording(tmp_path / "s", positions, arc_length=short * 0.99 / length)
    assert np.isclose(length, 0.99, atol=0.2)
    told = warnings("markers 5 and 6", "mm more than the rope between", of=Tracer(bad))
    assert len(told) == 1
    assert not warnings("markers 5 and 6", of=Tracer(fine))


def test_one_end_pose(tmp_path: Path) -> None:
    still = swaying(amplitude=0.0) + np.random.default_rng(0).normal(0, 1e-4, (40, 9, 3))
    assert warnings("all 40 frames show one end pose", of=Tracer(recording(tmp_path / "r", still)))
    moving = still.copy()
    moving[:, -1, 0] -= np.linspace(0, 0.05, 40)
    assert not warnings("one end pose", of=Tracer(recording(tmp_path / "s", moving)))
    turned = still.copy()  # the clamp at end 0 turns, the ends stay
    turned[:, 1, 1] += np.linspace(0, 0.02, 40)
    clamped = "markers = [[0, 1], [-1]]"
    assert not warnings("one end pose", of=Tracer(recording(tmp_path / "t", turned, clamped)))


def test_lines_that_cut_corners(tmp_path: Path) -> None:
    few = swaying()[:, ::4]
    chords = np.linalg.norm(np.diff(few, axis=1), axis=2).sum(axis=1)
    short = 1 - np.median(chords) / LENGTH
    assert short > 0.02
    (text,) = warnings("cut corners", of=Tracer(recording(tmp_path / "r", few)))
    assert f"{short:.1%}" in text


@pytest.mark.parametrize("name", ["markers", "cloud", "rgbd"])
def test_samples_have_nothing_to_warn_of(name: str) -> None:
    assert Tracer(open_recording(sample_path(name))).warnings == []
