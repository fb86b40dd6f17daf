"""A least-squares fit of the equilibrium model as an artifact."""

from __future__ import annotations

import numpy as np

from ropefit.adapters.parameter_group import outcome_of_fit, parameter_group
from ropefit.adapters.scene import build_scene
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Balance, Calibration, FittedModel, Observations, ParameterGroup
from ropefit.errors import NotConverged
from ropefit.inference.bins import Data, match, offsets
from ropefit.inference.evaluate import agreement
from ropefit.inference.intervals import Estimates
from ropefit.inference.least_squares import Fit
from ropefit.models import rest_curve
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import AT_REST, PARAMETERS
from ropefit.models.response import Point
from ropefit.models.rope_values import rope_values
from ropefit.models.terms import Term
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.branches import other_states
from ropefit.solvers.equilibrium.stability import stability

Part = tuple[Fit, Point, Estimates]


def describe_group(part: Part, frames: np.ndarray, o: Observations) -> ParameterGroup:
    """Return values, intervals and verdicts of one fit, in the units in which they are stated."""
    found, point, estimates = part
    # Rest curves that were not fitted are part of the setup.
    names = [n for n in AT_REST if n in estimates.of or n not in rest_curve.NAMES]
    ranges = {name: PARAMETERS[name].range(found.forward.base) for name in names}
    return parameter_group(
        frames, estimates, rope_values(point.setup), ranges, stated_units(o),
        outcome_of_fit(found.trace, found.cost, found.evaluations, found.converged),
    )  # fmt: skip


def fitted_model(
    o: Observations,
    loss: str,
    node: int,
    started: Setup,
    data: Data,
    parts: list[tuple[np.ndarray, Part]],
    groups: dict[str, ParameterGroup],
    out: np.ndarray,
    train: np.ndarray,
) -> FittedModel:
    """Return a model artifact of least-squares fits.

    parts: (frames' indices, fit) of each group; the rest as in `model_of`. Raises NotConverged.
    """
    found = parts[0][1][0]
    noise = found.problem.noise
    model = model_of(
        o, loss, "least-squares", node, started, data, [(mine, p[1]) for mine, p in parts],
        groups, out, train, np.array(found.trace),
    )  # fmt: skip
    assert model.balance is not None
    balance = model.balance.model_copy(
        update={
            "calibration": calibration_of(found),
            "correlated_noise": noise.correlated,
            "correlation_length": noise.length * o.length,
        }
    )
    return model.model_copy(update={"balance": balance})


def calibration_of(found: Fit) -> dict[str, Calibration]:
    """Return the errors of the set-up that were fitted, by name."""
    out, place, sd = {}, 0, found.sd()
    for term in found.forward.terms:
        for k, axis in enumerate(term.names if term.nuisance else ()):
            out[calibration_name(term, axis)] = Calibration(
                unit=term.units[k],
                prior=float(term.prior[k]),
                value=float(term.value(found.point.u[place : place + term.size])[k]),
                sd=float(sd[place + k] * term.scale[k]),
            )
        place += term.size
    return out


def calibration_name(term: Term, axis: str) -> str:
    """Return the name under which one value of a calibration error is reported."""
    return term.name if term.size == 1 else f"{term.name}_{axis}"


def model_of(
    o: Observations,
    loss: str,
    search: str,
    node: int,
    started: Setup,
    data: Data,
    points: list[tuple[np.ndarray, Point]],
    groups: dict[str, ParameterGroup],
    out: np.ndarray,
    train: np.ndarray,
    trace: np.ndarray,
) -> FittedModel:
    """Return a model artifact: states of all frames as the sensor reports them, and how they were
    found.

    node: the control point; started: where the fit set out; points: (frames' indices, states) of
    each group; out (F,) held out; train: indices of the frames of the fit; trace: the loss on its
    way. Raises NotConverged.
    """
    nodes = len(o.node_arc)
    every = started.segments // (nodes - 1)
    parts = [
        _states(started.frames(mine), point, data.frames(mine), every) for mine, point in points
    ]
    order = np.argsort(np.concatenate([mine for mine, _ in points]))
    s = {name: np.concatenate([part[name] for part in parts])[order] for name in parts[0]}
    setup = points[0][1].setup
    p = setup.properties
    weight = float(p.density.mean() * np.linalg.norm(setup.gravity))
    return FittedModel(
        solver="equilibrium",
        loss=loss,
        search=search,
        control_node=node,
        fixed_nodes=[
            n for n, kind in zip((0, nodes - 1), o.end_kind, strict=True) if kind != "free"
        ],
        two_sided=False,
        groups=groups,
        heldout=out,
        x=s["x"],
        q=s["q"],
        x_initial=s["x_initial"],
        residual=s["at_nodes"],
        rms=s["rms"],
        rms_initial=s["rms_initial"],
        rms_px=agreement(s["x"], build_scene(o)).rms_px,
        solver_converged=bool(s["converged"].all()),
        balance=Balance(
            segments=started.segments,
            newton=s["newton"],
            residual=np.nan_to_num(s["residual"], posinf=1e300),
            converged=s["converged"],
            stability=s["stability"],
            other=s["other"],
            mass_known=bool(o.mass),
            bending_length=float((p.bend.mean() / weight) ** (1 / 3)),
        ),
        trace=trace,
        rms_fit=float(np.sqrt(np.mean(s["rms"][train] ** 2))),
        rms_heldout=float(np.sqrt(np.mean(s["rms"][out] ** 2))) if out.any() else None,
    )


def _states(started: Setup, point: Point, data: Data, every: int) -> dict[str, np.ndarray]:
    """Return of each frame of a group the states as the sensor reports them, at every `every`-th
    node, their distance from the data, how they were found and how stable they are.

    Raises NotConverged.
    """
    solution = point.solution
    ok = solution.converged
    if not ok.any():
        raise NotConverged("no frame reaches an equilibrium at the fitted parameters")
    before = Equilibrium(started, []).at(np.empty(0))
    initial = np.nan_to_num(before.solution.x)
    seen = np.where(ok[:, None, None], point.seen, before.seen)
    seen = np.where(np.isfinite(seen), seen, np.nan_to_num(solution.x))
    return {
        "x": seen[:, ::every],
        "q": solution.q[:, every // 2 :: every],
        "x_initial": initial[:, ::every],
        "at_nodes": _at_nodes(data, seen, started.segments // every),
        "rms": _rms(data, seen),
        "rms_initial": _rms(data, initial),
        "newton": solution.iterations.astype(np.int64),
        "residual": solution.residual,
        "converged": ok,
        "stability": np.where(ok, stability(solution), np.nan),
        "other": other_states(solution)[1],
    }


def _rms(data: Data, x: np.ndarray) -> np.ndarray:
    """Return (F,) [m] distance of the data from the curve."""
    gap, mask = offsets(data, x)
    square = np.where(mask, (gap**2).sum(-1), 0.0).sum(1)
    return np.sqrt(square / np.maximum(mask.sum(1), 1))


def _at_nodes(data: Data, x: np.ndarray, bins: int) -> np.ndarray:
    """Return (F, bins + 1) [m] size of the mean offset near each node, NaN where nothing was
    seen."""
    s = match(data, x, bins)
    size = np.linalg.norm(s.residual, axis=1)
    node = np.rint(s.share * bins).astype(int)
    total, count = np.zeros((len(x), bins + 1)), np.zeros((len(x), bins + 1))
    np.add.at(total, (s.frame, node), size)
    np.add.at(count, (s.frame, node), 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
