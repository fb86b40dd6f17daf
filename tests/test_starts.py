"""Where a fit sets out from: one rule for every model and every search."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ropefit.inference.starts import best_start, cheaper, ranked


def some(**fields) -> Any:
    """Stand in for a fit."""
    return SimpleNamespace(**fields)


def tried(start) -> Any:
    """A trial that ends in the nearer of two minima, the deeper one at 3; none below -5."""
    if start[0] < -5:
        raise ArithmeticError(f"{start[0]:g} cannot be simulated")
    return some(u=3.0, cost=0.0) if start[0] > 1 else some(u=-1.0, cost=2.0)


def best(starts) -> Any:
    return best_start([np.array([u]) for u in starts], tried)


def test_the_best_of_the_starts_that_can_be_simulated_goes_on():
    assert best([-9.0, 0.0, 2.0, 4.0]).u == 3.0
    assert best([-9.0, 0.0]).u == -1.0
    with pytest.raises(ArithmeticError, match="-9 cannot"):
        best([-9.0])
    with pytest.raises(ArithmeticError, match="no start"):
        best([])


def test_a_fit_begun_anew_must_cost_less():
    old, new = some(cost=2.0), some(cost=1.5)
    assert cheaper(old, new) is new
    assert cheaper(old, new, by=0.6) is old
    assert cheaper(new, some(cost=1.5)) is new


def test_losses_are_ranked_with_failures_last_and_the_first_of_equals_first():
    losses = np.array([[3.0, np.nan, 1.0, 1.0], [np.inf, np.nan, np.nan, 7.0]])
    np.testing.assert_array_equal(ranked(losses, 3), [[2, 3, 0], [3, 0, 1]])
