"""A gripper that holds a rope part-way: what hangs beyond it is cut off, the rest is fitted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_bvp
from scipy.interpolate import CubicSpline

import ropefit
from reference_simulators.kirchhoff_rod import CLAMPED, PINNED, Ends, facing, hang
from reference_simulators.rod_equations import Rod
from ropefit.errors import BadInput
from tests.factories import write_manifest, write_ply

EI, DENSITY, LENGTH, GRIP = 1.5e-3, 0.06, 1.0, 0.7  # N m², kg/m, m, m
FRAMES, NOISE = 6, 0.0003  # m
SLOPES = np.radians([-30, 0, 20, 40, 60, 10])  # of the rope at the grip, in the plane x z
GRIPS = np.stack([np.linspace(0.35, 0.6, FRAMES), 0 * SLOPES, np.linspace(0, 0.1, FRAMES)], axis=1)


def along(slope: float) -> np.ndarray:
    return np.array([np.cos(slope), 0.0, np.sin(slope)])


def whole_rope() -> np.ndarray:
    """(F, 201, 3) [m] ropes at equal steps of arc length: two solutions that meet at the grip."""
    s = np.linspace(0, LENGTH, 201)
    turns = np.array([np.roll(facing(along(a)).as_quat(), 1) for a in SLOPES])
    starts = np.zeros((FRAMES, 3))
    held = Ends(np.stack([starts, GRIPS], 1), np.stack([turns, turns], 1), (PINNED, CLAMPED))
    solved, y = hang(Rod(GRIP, DENSITY, EI, EI), held)
    before = CubicSpline(solved.mesh, y[:, :, :3], axis=1)(s[s <= GRIP])
    weight, rest = DENSITY * 9.81, LENGTH - GRIP
    u = s[s > GRIP] - GRIP
    beyond = []
    for slope, grip in zip(SLOPES, GRIPS, strict=True):

        def bends(u, v):
            return np.stack([v[1], weight * (rest - u) * np.cos(v[0]) / EI])

        def held_there(a, b, slope=slope):
            return np.array([a[0] - slope, b[1]])

        fine = np.linspace(0, rest, 301)
        angle = solve_bvp(bends, held_there, fine, np.full((2, 301), [[slope], [0.0]])).sol(fine)[0]
        steps = np.stack([np.cos(angle), 0 * angle, np.sin(angle)], axis=1)
        path = CubicSpline(fine, steps).antiderivative()(u)
        beyond.append(grip + path)
    return np.concatenate([before, np.stack(beyond)], axis=1)


def recording(directory: Path, tangents: bool, clouds: bool = False, held: str = "") -> Path:
    directory.mkdir(parents=True)
    rng, x = np.random.default_rng(11), whole_rope()
    table = '[markers]\nfile = "markers.npz"\n'
    if clouds:
        table = '[clouds]\npattern = "clouds/{frame:03d}.ply"\n'
        (directory / "clouds").mkdir()
        fine = CubicSpline(np.linspace(0, 1, 201), x, axis=1)(np.linspace(0, 1, 3000))
        for frame, line in enumerate(fine + rng.normal(0, 0.001, fine.shape)):
            write_ply(directory / "clouds" / f"{frame:03d}.ply", line)
    else:
        points = x[:, ::10] + rng.normal(0, NOISE, (FRAMES, 21, 3))
        np.savez(directory / "markers.npz", positions=points, arc_length=np.linspace(0, 1, 21))
    ends = f'file = "ends.csv"\narc_length = [0.0, {held or GRIP}]'
    write_manifest(directory, table, "length = 1.0\nmass = 0.06", ends)
    rows = ["frame,end,x,y,z" + (",tx,ty,tz" if tangents else "")]
    for frame in range(FRAMES):
        tail = [",,,", "".join(f",{v:.9f}" for v in along(SLOPES[frame]))]
        for end, place in ((0, np.zeros(3)), (1, GRIPS[frame])):
            row = f"{frame},{end}" + "".join(f",{v:.9f}" for v in place)
            rows.append(row + (tail[end] if tangents else ""))
    (directory / "ends.csv").write_text("\n".join(rows) + "\n")
    return directory


@pytest.mark.parametrize("clouds", [False, True])
def test_the_rope_between_the_grips_is_the_rope(clouds: bool, tmp_path: Path) -> None:
    o = ropefit.preprocess(recording(tmp_path / "r", True, clouds))
    assert o.length == pytest.approx(GRIP)
    assert o.mass == pytest.approx(DENSITY * GRIP)
    assert o.end_kind == ("pinned", "clamped")
    assert not o.end_twist_known
    group = next(iter(ropefit.fit(o, solver="equilibrium", free=["EI"]).nominal.groups.values()))
    found = group.parameters["EI"]
    print(clouds, found)
    assert found.ci95 is not None
    low, high = found.ci95
    assert low < EI < high
    assert high < 1.5 * low


def test_a_grip_that_the_rope_does_not_pass_is_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="lies on the rope"):
        ropefit.preprocess(recording(tmp_path / "r", True, held="1.2"))


def test_the_direction_at_such_a_grip_must_be_known(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match="direction there must be known"):
        ropefit.preprocess(recording(tmp_path / "r", False))


def test_clouds_need_an_end_that_is_the_ropes_own(tmp_path: Path) -> None:
    where = recording(tmp_path / "r", True, clouds=True)
    rows = (where / "ends.csv").read_text().replace(",,,", ",1,0,0")
    (where / "ends.csv").write_text(rows)
    text = (where / "recording.toml").read_text().replace("[0.0, 0.7]", "[0.1, 0.7]")
    (where / "recording.toml").write_text(text)
    with pytest.raises(BadInput, match="rope beyond them"):
        ropefit.preprocess(where)
