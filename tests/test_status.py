"""What a status says: one type for equilibria and motions."""

from __future__ import annotations

from ropefit.solvers.dynamics.kernels import simulate
from ropefit.solvers.equilibrium.kernels import newton
from ropefit.solvers.status import Status


def test_every_status_has_words_of_its_own() -> None:
    assert len({status.advice for status in Status}) == len(Status)
    assert Status.CONVERGED.step_advice == Status.CONVERGED.advice == "converged"
    for status in (Status.LIMIT, Status.NOT_FINITE):
        assert "smaller steps" in status.step_advice
        assert status.step_advice != status.advice


def test_compiled_code_returns_the_same_numbers() -> None:
    for module, names in (
        (newton, [status.name for status in Status]),
        (simulate, ["CONVERGED", "LIMIT", "NOT_FINITE"]),
    ):
        assert {name: getattr(module, name) for name in names} == {
            name: Status[name].value for name in names
        }
