"""What `import ropefit` cannot do is a RopefitError, never a wrong number."""

from __future__ import annotations

import numpy as np
import pytest
import torch

import ropefit
from ropefit.errors import RopefitError
from tests.conftest import SAMPLES

ENDS = torch.tensor([[[0.0, 0.0, 0.0], [0.6, 0.0, 0.0]]], dtype=torch.float64)


def lowest(EI: torch.Tensor) -> torch.Tensor:
    return ropefit.Rope(length=1.0, mass=0.05, EI=EI, segments=10)(ENDS)[0, 5, 2]


@pytest.mark.parametrize(
    "wrong",
    [
        {"EI": -1e-3}, {"EI": 0.0}, {"mass": 0.0}, {"length": float("nan")}, {"GJ": -1.0},
        {"EA": 0.0}, {"segments": 1}, {"EI": torch.tensor([1e-3, -1e-3, 1e-3])},
        {"mass": float("inf")},
    ],
)  # fmt: skip
def test_no_such_rope(wrong) -> None:
    fine = {"length": 1.0, "mass": 0.05, "EI": 1e-3, "segments": 3}
    ropefit.Rope(**fine)
    with pytest.raises(RopefitError, match=next(iter(wrong))):
        ropefit.Rope(**fine | wrong)


def test_a_second_derivative_raises() -> None:
    EI = torch.tensor(2e-4, dtype=torch.float64, requires_grad=True)
    (first,) = torch.autograd.grad(lowest(EI), EI, create_graph=True)
    (plain,) = torch.autograd.grad(lowest(EI), EI)
    assert first.detach() == pytest.approx(float(plain))
    with pytest.raises(RopefitError, match="second derivative"):
        torch.autograd.grad(first, EI)


def test_transforms_say_what_to_use_instead() -> None:
    EI = torch.tensor([2e-4, 4e-4], dtype=torch.float64)
    for transformed in (torch.func.vmap(lowest), torch.func.jacrev(lowest)):
        with pytest.raises(RopefitError, match=r"torch\.autograd\.functional\.jacobian"):
            transformed(EI if transformed.__name__ != "jacrev" else EI[0])
    jacobian = torch.autograd.functional.jacobian(
        lambda bend: ropefit.Rope(1.0, 0.05, bend, segments=10)(ENDS)[0, :, 2], EI[0]
    )
    step = 1e-8
    near = [ropefit.Rope(1.0, 0.05, float(EI[0]) + s, segments=10)(ENDS) for s in (-step, step)]
    expected = ((near[1] - near[0]) / (2 * step))[0, :, 2]
    np.testing.assert_allclose(jacobian, expected, rtol=1e-4, atol=1e-3)


def test_misspelt_keywords() -> None:
    seen = ropefit.preprocess(SAMPLES / "markers", nodes=6)
    with pytest.raises(RopefitError, match=r"most_frame: .* did you mean most_frames"):
        ropefit.fit(seen, most_frame=3)
    with pytest.raises(RopefitError, match="loss"):
        ropefit.fit(seen, loss="OBJ99")
    with pytest.raises(RopefitError, match="unknown parameter EJ"):
        ropefit.fit(seen, free="EI,EJ")
    with pytest.raises(RopefitError, match="nodes"):
        ropefit.preprocess(SAMPLES / "markers", nodes=-1)
