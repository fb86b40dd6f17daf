"""Motions with the clips side by side, as on a device: the same states and derivatives."""

import numpy as np
import pytest
import torch

from ropefit.rod.fields import PLANE
from ropefit.rod.moving import Moving
from ropefit.solvers.batched.simulate import simulate_batched, step_batched
from ropefit.solvers.dynamics.differentiable import simulate
from ropefit.solvers.dynamics.problem import Drive, Start
from ropefit.solvers.dynamics.solve import solve
from ropefit.solvers.status import Status
from tests.test_dynamics_gradients import NAMES, changed

CPU = torch.device("cpu")
CASES = {
    "clamped, extensible": ((True, True), 30.0),
    "clamped, inextensible": ((True, True), torch.inf),
    "one clamp": ((True, False), 30.0),
    "pinned": ((False, False), torch.inf),
    "a free end": ((True, False), torch.inf),
}


def two(steps: int, clamped, axial, amounts) -> tuple[Moving, Drive, Start, np.ndarray]:
    """Two ropes and three clips of them."""
    one = changed(amounts, steps, clamped, axial)
    other = changed({n: a + 0.01 for n, a in amounts.items()}, steps, clamped, axial)

    def joined(a, b):
        a, b = (t if t.ndim and len(t) == 1 else t[None] for t in (a, b))
        return torch.cat([a, b])

    rod = type(one[0].rod)(
        *(torch.stack([a, b]) for a, b in zip(one[0].rod, other[0].rod, strict=True))
    )
    rest = (torch.stack([a, b]) for a, b in zip(one[0][1:], other[0][1:], strict=True))
    drive = Drive(*(torch.cat([a, b, b]) for a, b in zip(one[1], other[1], strict=True)))
    start = Start(*(torch.cat([a, b, a]) for a, b in zip(one[2], other[2], strict=True)))
    return Moving(rod, *rest), drive, start, np.array([0, 1, 0])


@pytest.mark.parametrize("name", CASES)
def test_states_and_gradients_of_the_compiled_path(name):
    steps = 40
    clamped, axial = CASES[name]
    weights = torch.from_numpy(np.random.default_rng(7).normal(size=(3, steps, 13, 3)))
    q_weights = torch.from_numpy(np.random.default_rng(8).normal(size=(3, steps, 12, 4)))
    found = {}
    for way in ("compiled", "batched"):
        names = [n for n in NAMES if n != "clamps" or all(clamped)]  # NaN: not clamped
        amounts = {n: torch.zeros((), dtype=torch.float64, requires_grad=True) for n in names}
        rope, drive, start, member = two(steps, clamped, axial, amounts)
        if name == "a free end":
            nowhere = torch.full_like(drive.ends[:, :, 1], torch.nan)
            drive = drive._replace(ends=torch.stack([drive.ends[:, :, 0], nowhere], 2))
        if way == "compiled":
            x, q, _ = simulate(rope, drive, start, member)
        else:
            x, q, _ = simulate_batched(rope, drive, start, CPU, member)
        loss = (weights * x).sum() + (q_weights * q).sum()
        gradient = torch.autograd.grad(loss, list(amounts.values()), allow_unused=True)
        found[way] = x.detach(), q.detach(), [0.0 if g is None else float(g) for g in gradient]
    for a, b in zip(found["compiled"][:2], found["batched"][:2], strict=True):
        assert (a - b).abs().max() < 1e-9
    expected = np.array(found["compiled"][2])
    assert (np.abs(expected) > 1e-6).sum() >= 10
    np.testing.assert_allclose(found["batched"][2], expected, rtol=1e-7, atol=1e-9)


def test_contact_and_clips_in_parts_are_those_of_the_compiled_path(monkeypatch):
    def in_parts(clips, each, device):
        assert each > 0
        return [slice(0, 2), slice(2, clips)]

    monkeypatch.setattr("ropefit.solvers.batched.threads._parts", in_parts)
    weights = torch.from_numpy(np.random.default_rng(9).normal(size=(3, 40, 13, 3)))
    found = {}
    for way in ("compiled", "batched"):
        amounts = {n: torch.zeros((), dtype=torch.float64, requires_grad=True) for n in NAMES}
        rope, drive, start, member = two(40, (True, True), 30.0, amounts)
        lowest = float(start.x.detach()[..., 2].min())
        plane = torch.tensor([0.0, 0.0, lowest + 0.02, 0.0, 0.0, 1.0, 0.0, PLANE])
        rows = torch.zeros_like(rope.bodies)
        rows[:1, 0] = plane  # of one of the ropes only
        rope = rope._replace(bodies=rows.requires_grad_())
        if way == "compiled":
            x, _, _ = simulate(rope, drive, start, member)
        else:
            x, _, _ = simulate_batched(rope, drive, start, CPU, member)
        inputs = [*amounts.values(), rope.bodies]
        gradient = torch.autograd.grad((weights * x).sum(), inputs, allow_unused=True)
        gradient = [torch.zeros(1) if g is None else g for g in gradient]
        found[way] = x.detach(), torch.cat([g.double().ravel() for g in gradient])
    assert (found["compiled"][0] - found["batched"][0]).abs().max() < 1e-9
    expected = found["compiled"][1]
    assert expected[-32:].abs().max() > 1e-6  # it touches
    torch.testing.assert_close(found["batched"][1], expected, rtol=1e-7, atol=1e-9)


def test_a_clip_that_fails_leaves_the_others():
    zeros = {n: torch.zeros((), dtype=torch.float64) for n in NAMES}
    rope, drive, start, member = two(10, (True, True), 30.0, zeros)
    ends = drive.ends.clone()
    ends[1, 5:, 1, 0] += 3.0  # three times its length away within a step
    torn = drive._replace(ends=ends)
    one, other = (
        solve(rope, torn, start, member),
        step_batched(rope, torn, start, CPU, member).trajectory(),
    )
    np.testing.assert_array_equal(other.status, one.status)
    np.testing.assert_array_equal(other.done, one.done)
    assert list(one.converged) == [True, False, True]
    assert np.isnan(other.x[1, one.done[1] :]).all()
    np.testing.assert_allclose(other.x[[0, 2]], one.x[[0, 2]], rtol=0, atol=1e-9)
    np.testing.assert_array_equal(other.iterations[[0, 2]], one.iterations[[0, 2]])
    with pytest.raises(ArithmeticError, match=f"clip 1, step {one.done[1]}"):
        simulate_batched(rope, torn, start, CPU, member)
    assert Status(int(one.status[1])) is not Status.CONVERGED
