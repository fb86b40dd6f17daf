"""Parameters that another run found, for a rope that is recorded again."""

from __future__ import annotations

import numpy as np

from ropefit.artifacts import Model, Observations
from ropefit.artifacts.model import FittedModel, ParameterGroup
from ropefit.errors import WrongUsage
from ropefit.inference.verdict import NORMAL_QUANTILE
from ropefit.models import rest_curve

PER_WEIGHT = ("EI", "GJ", "EA", "bend_damping", "air_damping")  # in proportion to the mass


def frozen_values(model: Model, where: str, o: Observations) -> dict[str, float]:
    """Return another run's parameters in the units in which those of `o` are stated.

    Ratios to the weight are carried over where one of the two does not know its mass. The length is
    taken only where it was fitted there or is estimated here, and not from a rope in motion, which
    begins at its grips. Raises WrongUsage.
    """
    m = model.nominal
    solved = m.balance or m.stepped
    if solved is None:
        raise WrongUsage(
            f"{where}: its model is one of the {m.solver} solver, whose weights are no "
            "properties of the rope; identify it with --solver equilibrium"
        )
    if len(m.groups) != 1:
        raise WrongUsage(
            f"{where}: it has {len(m.groups)} parameter sets; identify it with --groups one"
        )
    (group,) = m.groups.values()
    known, factor = group.parameters, weight_factor(m, o)
    out = {name: factor * known[name].value for name in PER_WEIGHT if name in known}
    out |= {name: p.value for name, p in known.items() if name in rest_curve.NAMES}
    if m.balance and (known["length"].free or o.length_source == "estimated"):
        out["length"] = known["length"].value
    return out


def weight_factor(m: FittedModel, o: Observations) -> float:
    """Return what weights, forces and rigidities of another run are multiplied by in that of `o`,
    where one of the two does not know the mass of the rope."""
    solved = m.balance or m.stepped
    assert solved is not None
    known = next(iter(m.groups.values())).parameters
    weight = known["EI"].value / solved.bending_length**3 if solved.mass_known else 1.0
    here = o.mass / o.length * float(np.linalg.norm(o.gravity)) if o.mass else 1.0
    return 1.0 if solved.mass_known and o.mass else here / weight


def covariance_of(group: ParameterGroup, names: list[str]) -> np.ndarray:
    """Return (n, n) covariance in SI of parameters that are no logarithms and have intervals."""
    ends = np.array([group.parameters[name].ci95 for name in names])
    sd = 0.5 * (ends[:, 1] - ends[:, 0]) / NORMAL_QUANTILE
    place = [group.free_names.index(name) for name in names]
    correlation = np.nan_to_num(group.correlation[np.ix_(place, place)])
    np.fill_diagonal(correlation, 1.0)
    return correlation * np.outer(sd, sd)
