"""How a solve ended, and what to do about it."""

from __future__ import annotations

from enum import IntEnum


class Status(IntEnum):
    """How Newton's method ended in a frame, or in a step of a clip."""

    CONVERGED = 0
    LIMIT = 1
    STUCK = 2
    NOT_FINITE = 3
    UNSTABLE = 4

    @property
    def advice(self) -> str:
        """Return in words how an equilibrium was missed, and what to try."""
        return _ADVICE[self]

    @property
    def step_advice(self) -> str:
        """Return in words how a step of a motion failed, and what to try."""
        return _STEP_ADVICE.get(self, self.advice)


_ADVICE = {
    Status.CONVERGED: "converged",
    Status.LIMIT: "iteration limit reached; give more iterations or a nearer start",
    Status.STUCK: "no step lowers the energy; are the ends farther apart than the rope is long?",
    Status.NOT_FINITE: "not finite; look at the rod and its ends",
    Status.UNSTABLE: "in equilibrium, but not stable",
}
_STEP_ADVICE = {
    Status.LIMIT: "a step did not converge within the iteration limit: use smaller steps",
    Status.NOT_FINITE: "a step left the numbers: use smaller steps",
}
