"""A least-squares fit of the equilibrium model as an artifact."""

from __future__ import annotations

import numpy as np
import torch

from ropefit.artifacts import (
    Balance,
    Calibration,
    FittedModel,
    Observations,
    Parameter,
    ParameterGroup,
)
from ropefit.errors import NotConverged
from ropefit.inference import rest_curve
from ropefit.inference.equilibrium_rope import MEANING, NAMES, ranges
from ropefit.inference.evaluate import agreement
from ropefit.inference.forward import Forward, Term
from ropefit.inference.least_squares import Fit
from ropefit.inference.limits import Limits
from ropefit.inference.noise import Noise
from ropefit.inference.response import Point
from ropefit.inference.stations import Data, match, offsets
from ropefit.rod.setup import Setup
from ropefit.solvers.equilibrium.branches import other_states
from ropefit.solvers.equilibrium.stability import stability
from ropefit.stages.scene import build_scene

Part = tuple[Fit, Noise, Point, dict[str, Limits]]


def meanings(o: Observations) -> dict[str, str]:
    """What each parameter is; without the mass, ratios to the weight."""
    return {
        name: text + ("" if o.mass or name == "length" else " over the weight per length")
        for name, text in MEANING.items()
    }


def describe_group(
    part: Part,
    frames: np.ndarray,
    free: list[str],
    scale: dict[str, tuple[float, str]],
    o: Observations,
) -> ParameterGroup:
    """Values, intervals and verdicts of one fit, in the units that are told."""
    found, _, point, told = part
    parameters = {}
    settled = ranges(point.setup)
    begun = ranges(found.forward.base)
    for name in NAMES:
        factor, unit = scale[name]
        value, low, high = settled[name]
        initial = begun[name][0]
        if not np.isfinite(value):
            continue  # a rope that does not stretch has no EA to tell
        verdict, interval, below, partners = "fixed", None, None, ()
        if name in told:
            t = told[name]
            verdict, partners = t.verdict if found.converged else "not converged", t.partners
            interval = None if t.interval is None else tuple(factor * v for v in t.interval)
            below = None if t.below is None else factor * t.below
        parameters[name] = Parameter(
            meaning=meanings(o)[name],
            unit=unit,
            initial=factor * initial if np.isfinite(initial) else factor * value,
            value=factor * value,
            lower=factor * low,
            upper=factor * high,
            free=name in free,
            verdict=verdict,
            ci95=interval,  # type: ignore[arg-type]
            below=below,
            trades_with=list(partners),
        )
    count = len(free)
    parameters |= {
        name: Parameter(
            meaning=rest_curve.meaning(name),
            unit="1/m",
            initial=0.0,
            value=t.value,
            lower=-rest_curve.bound(name, point.setup),
            upper=rest_curve.bound(name, point.setup),
            free=True,
            verdict=t.verdict if found.converged else "not converged",
            ci95=t.interval,
            trades_with=list(t.partners),
        )
        for name, t in told.items()
        if name in rest_curve.NAMES
    }
    names = [t.name for t in found.forward.terms if not t.nuisance]
    covariance = found.covariance[:count, :count]
    root = np.sqrt(np.maximum(np.diag(covariance), 1e-300))
    # Of the rope's own parameters, calibration errors taken into account.
    values = np.linalg.eigvalsh(covariance / np.outer(root, root)) if count else np.ones(1)
    condition = float(np.sqrt(values[-1] / values[0])) if values[0] > 0 else None
    return ParameterGroup(
        frames=frames,
        parameters=parameters,
        free_names=names,
        correlation=covariance / np.outer(root, root),
        condition=condition,
        loss_before=found.trace[0],
        loss_after=found.cost,
        loss_unit="chi-square",
        evaluations=found.evaluations,
        converged=found.converged,
        stop_reason="residual no longer decreases" if found.converged else "evaluation limit",
    )


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
    """A model artifact of least-squares fits.

    parts: (frames' indices, fit) of each group; the rest as in `model_of`. Raises NotConverged.
    """
    found, noise, _, _ = parts[0][1]
    model = model_of(
        o, loss, "least-squares", node, started, data, [(mine, p[2]) for mine, p in parts],
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
    """The errors of the set-up that were fitted, by name."""
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
    """The name under which one value of a calibration error is told."""
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
    """A model artifact: states of all frames as the sensor reports them, and how they were found.

    node: the control point; started: where the fit set out; points: (frames' indices, states) of
    each group; out (F,) held out; train: indices of the frames of the fit; trace: the loss on its
    way. Raises NotConverged.
    """
    frames, nodes = len(o.frames), len(o.node_arc)
    every = started.segments // (nodes - 1)
    x, q = np.zeros((frames, nodes, 3)), np.zeros((frames, nodes - 1, 4))
    first, residual = x.copy(), np.full((frames, nodes), np.nan)
    rms, rms_initial = np.zeros(frames), np.zeros(frames)
    newton, worst = np.zeros(frames, dtype=np.int64), np.zeros(frames)
    ok = np.zeros(frames, dtype=bool)
    stable, other = np.full(frames, np.nan), np.full(frames, np.nan)
    for mine, point in points:
        solution = point.solution
        ok[mine], newton[mine] = solution.converged, solution.iterations
        worst[mine] = solution.residual
        if not solution.converged.any():
            raise NotConverged("no frame reaches an equilibrium at the fitted parameters")
        bare = Forward(started.frames(torch.from_numpy(mine)), [])
        before = bare.at(np.empty(0))
        seen = np.where(solution.converged[:, None, None], point.seen, before.seen)
        seen = np.where(np.isfinite(seen), seen, np.nan_to_num(solution.x))
        x[mine], q[mine] = seen[:, ::every], solution.q[:, every // 2 :: every]
        first[mine] = np.nan_to_num(before.solution.x)[:, ::every]
        mine_data = data.frames(mine)
        rms[mine] = _rms(mine_data, seen)
        rms_initial[mine] = _rms(mine_data, np.nan_to_num(before.solution.x))
        stable[mine] = stability(solution)
        other[mine] = other_states(solution)[1]
        residual[mine] = _at_nodes(mine_data, seen, nodes - 1)
    stable[~ok] = np.nan
    setup = points[0][1].setup
    p = setup.properties
    weight = float(p.density.mean() * setup.gravity.norm())
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
        x=x,
        q=q,
        x_initial=first,
        residual=residual,
        rms=rms,
        rms_initial=rms_initial,
        rms_px=agreement(torch.from_numpy(x), build_scene(o)).rms_px,
        solver_converged=bool(ok.all()),
        balance=Balance(
            segments=started.segments,
            newton=newton,
            residual=np.nan_to_num(worst, posinf=1e300),
            converged=ok,
            stability=stable,
            other=other,
            mass_known=bool(o.mass),
            bending_length=float((p.bend.mean() / weight) ** (1 / 3)),
        ),
        trace=trace,
        rms_fit=float(np.sqrt(np.mean(rms[train] ** 2))),
        rms_heldout=float(np.sqrt(np.mean(rms[out] ** 2))) if out.any() else None,
    )


def _rms(data: Data, x: np.ndarray) -> np.ndarray:
    """(F,) [m] distance of the data from the curve."""
    gap, mask = offsets(data, x)
    square = np.where(mask, (gap**2).sum(-1), 0.0).sum(1)
    return np.sqrt(square / np.maximum(mask.sum(1), 1))


def _at_nodes(data: Data, x: np.ndarray, bins: int) -> np.ndarray:
    """(F, bins + 1) [m] size of the mean offset near each node, NaN where nothing was seen."""
    s = match(data, x, bins)
    size = np.linalg.norm(s.residual, axis=1)
    node = np.rint(s.share * bins).astype(int)
    total, count = np.zeros((len(x), bins + 1)), np.zeros((len(x), bins + 1))
    np.add.at(total, (s.frame, node), size)
    np.add.at(count, (s.frame, node), 1)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
