"""`ropefit identify`: the parameters that make simulation and recording agree."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from ropefit.cli.options import (
    OF_EXPERTS,
    OF_PAPER,
    ControlAt,
    Device,
    DeviceOption,
    Force,
    LossOption,
    MostFrames,
    OptionalPath,
    OptionalText,
    Run,
    SearchOption,
    SolverOption,
    Texts,
    command,
)

if TYPE_CHECKING:
    from ropefit.artifacts import FittedModel, Model, Stepped
    from ropefit.cli.console import Session
    from ropefit.runs.protocol import Outcome

FREE = (
    "The parameters to fit, with commas between. Of a rod: EI, GJ, EA, length, curvature_1 and "
    "curvature_2 (a uniform rest curvature about the rope's two directions), or rest_curve (both "
    "curvatures at five places along the rope); in motion also bend_damping and air_damping. Of "
    "the paper's solvers: their weights. By default EI, and the length where it was estimated."
)

Free = Annotated[OptionalText, typer.Option(help=FREE)]
Start = Annotated[
    Texts,
    typer.Option(
        help="NAME=VALUE: the value that a parameter starts from, and keeps if it is not "
        "free. Repeatable."
    ),
]
FromRun = Annotated[
    OptionalPath,
    typer.Option(
        "--from",
        help="Another run of the same rope, whose parameters are kept; those of --free are "
        "fitted still (equilibrium only).",
    ),
]
LawOption = Annotated[
    OptionalText,
    typer.Option(
        help="bending: fit the bending moment as a function of the curvature besides, as a "
        "curve with its band and its form (equilibrium only)."
    ),
]
Groups = Annotated[
    str,
    typer.Option(
        help="Parameter sets: one for all frames, one for each tension, or one for each of "
        "some frame ranges like 0-17,18-35.",
        rich_help_panel=OF_EXPERTS,
    ),
]
TwoSided = Annotated[
    bool,
    typer.Option(
        help="Fit a gravity weight for each side of the control point.",
        rich_help_panel=OF_PAPER,
    ),
]
Steps = Annotated[
    int, typer.Option(help="The gravity steps of Algorithm 1.", rich_help_panel=OF_PAPER)
]
Iterations = Annotated[
    int, typer.Option(help="The constraint iterations of a step.", rich_help_panel=OF_PAPER)
]
TimeStep = Annotated[
    float,
    typer.Option(help="The time step of the gravity prediction [s].", rich_help_panel=OF_PAPER),
]
Compliance = Annotated[
    str,
    typer.Option(
        help="The XPBD compliances of shear, bend and distance; 0 is a hard constraint.",
        rich_help_panel=OF_PAPER,
    ),
]
Evaluations = Annotated[
    int,
    typer.Option(
        help="The most evaluations of a gradient or least-squares search.",
        rich_help_panel=OF_EXPERTS,
    ),
]
Levels = Annotated[
    int,
    typer.Option(help="Grid search: the values per parameter.", rich_help_panel=OF_EXPERTS),
]
Rounds = Annotated[
    int,
    typer.Option(help="Grid search: the refinements.", rich_help_panel=OF_EXPERTS),
]
Holdout = Annotated[
    float,
    typer.Option(
        help="The share of the frames that is held out, in blocks.", rich_help_panel=OF_EXPERTS
    ),
]


@command
def identify(
    session: Session,
    run: Run = Path("run"),
    solver: SolverOption = "equilibrium",
    loss: LossOption = "OBJ1",
    search: SearchOption = None,
    free: Free = None,
    start: Start = None,
    from_run: FromRun = None,
    law: LawOption = None,
    groups: Groups = "one",
    two_sided: TwoSided = False,
    control_at: ControlAt = None,
    steps: Steps = 50,
    iterations: Iterations = 20,
    dt: TimeStep = 0.1,
    compliance: Compliance = "0,0,0",
    evaluations: Evaluations = 60,
    levels: Levels = 3,
    rounds: Rounds = 3,
    holdout: Holdout = 0.2,
    most_frames: MostFrames = 60,
    device: DeviceOption = Device.cpu,
    force: Force = False,
) -> None:
    """Find the parameters that make simulation and recording agree."""
    from ropefit.api import runs
    from ropefit.cli.parsing import numbers, starts

    settings = {
        "solver": solver,
        "loss": loss,
        "search": search.value if search else None,
        "free": free.split(",") if free else None,
        "start": starts(start or []),
        "law": law,
        "groups": groups,
        "two_sided": two_sided,
        "control_at": control_at,
        "steps": steps,
        "iterations": iterations,
        "dt": dt,
        "compliance": numbers("--compliance", compliance, 3),
        "evaluations": evaluations,
        "levels": levels,
        "rounds": rounds,
        "holdout": holdout,
        "most_frames": most_frames,
        "device": device.value,
    }
    outcome = runs.identify(run, settings, session.context("identify"), from_run, force)
    session.result(show_model(session, outcome))


def show_model(session: Session, outcome: Outcome[Model]) -> dict[str, Any]:
    """Print what was identified, and return its summary."""
    import numpy as np

    from ropefit.api.summaries import identified

    session.finished("identify", outcome)
    model = outcome.artifact
    m = model.nominal
    session.table(
        f"{model.recording}: {m.solver}, {m.loss}, {m.search}",
        ["parameter", "start", "fitted", "95 % interval", "verdict"],
        _rows(m),
    )
    for cause in m.laws.values():
        session.say(cause.sentence)
    heldout = "none held out" if m.rms_heldout is None else f"held out {m.rms_heldout * 1e3:.3g} mm"
    session.say(
        f"point-to-line rms: fitted frames {m.rms_fit * 1e3:.3g} mm, {heldout}, "
        f"at the start {np.sqrt(np.mean(m.rms_initial**2)) * 1e3:.3g} mm"
    )
    _say_how_it_settled(session, m)
    for group in m.groups.values():
        if not group.converged:
            session.say(f"warning: the search did not converge ({group.stop_reason})")
    return identified(outcome)


def _rows(m: FittedModel) -> list[list[str]]:
    """Return a row a parameter: its name, its values, its interval, its verdict."""
    rows = []
    for name, group in m.groups.items():
        for key, p in group.parameters.items():
            interval = f"{p.ci95[0]:.4g} .. {p.ci95[1]:.4g}" if p.ci95 else "-"
            if p.below is not None:
                interval = f"below {p.below:.4g}"
            partners = f" with {', '.join(p.trades_with)}" if p.trades_with else ""
            label = f"{name} {key}" if len(m.groups) > 1 else key
            label += "" if p.unit == "1" else f" [{p.unit}]"
            rows.append(
                [label, f"{p.initial:.4g}", f"{p.value:.4g}", interval, p.verdict + partners]
            )
    return rows


def _say_how_it_settled(session: Session, m: FittedModel) -> None:
    import numpy as np

    if m.iterated and not m.solver_converged:
        session.say(
            f"the solver has not converged: iterated twice as long, particles move by "
            f"{np.median(m.iterated.drift):.2%} of the length; the weights belong to "
            f"{m.iterated.steps} x {m.iterated.iterations} iterations and are not properties of "
            "the rope"
        )
    if m.stepped:
        _say_how_it_moved(session, m.stepped)
    if m.balance is None:
        return
    b = m.balance
    if not b.mass_known:
        session.say(
            "the mass is not known: shapes fix rigidities over the weight per length only; bending "
            f"length (EI/w)^(1/3) = {b.bending_length:.4g} m"
        )
    lost = int((~b.converged).sum())
    if lost:
        session.say(f"warning: {lost} of {len(b.converged)} frames reach no equilibrium (marked)")
    twice = int(np.isfinite(b.other).sum())
    if twice:
        session.say(f"{twice} of {len(b.other)} frames have a second stable equilibrium")


def _say_how_it_moved(session: Session, s: Stepped) -> None:
    if not s.mass_known:
        session.say(
            "the mass is not known: motion too fixes rigidities and dampings over the weight per "
            f"length only; bending length (EI/w)^(1/3) = {s.bending_length:.4g} m"
        )
    short = int((s.clip < 0).sum())
    if short:
        session.say(f"{short} frames belong to no clip that is long enough: left as observed")
