"""`ropefit run`: every stage, then the report."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ropefit.cli.control import show_control
from ropefit.cli.diagnose import show_diagnosis
from ropefit.cli.identify import show_model
from ropefit.cli.options import (
    CalibrationRun,
    ControlAt,
    DebugImages,
    ForceOther,
    LossOption,
    Mask,
    Nodes,
    NominalRun,
    Project,
    ProjectChoice,
    RecordingPath,
    Roi,
    RopeColor,
    Run,
    SearchOption,
    SolverOption,
    Target,
    command,
)
from ropefit.cli.preprocess import show_observations
from ropefit.cli.report import show_report

if TYPE_CHECKING:
    from ropefit.cli.console import Session


@command
def run(
    session: Session,
    recording: RecordingPath = None,
    run: Run = Path("run"),
    nodes: Nodes = 20,
    project: Project = ProjectChoice.auto,
    solver: SolverOption = "equilibrium",
    loss: LossOption = "OBJ1",
    search: SearchOption = None,
    control_at: ControlAt = None,
    nominal: NominalRun = None,
    calibration: CalibrationRun = None,
    target: Target = None,
    color: RopeColor = None,
    roi: Roi = None,
    mask: Mask = None,
    debug_images: DebugImages = None,
    force: ForceOther = False,
) -> None:
    """Compute every stage of a recording, then write the report.

    A rope in motion (--solver dynamics) is controlled only towards a --target.
    """
    from ropefit.api import runs
    from ropefit.cli.parsing import picture_settings

    seen = {"nodes": nodes, "project": project.value, **picture_settings(color, roi, mask)}
    data = {"preprocess": show_observations(session, recording, run, seen, force, debug_images)}
    if target:  # before anything is fitted
        runs.check_targets(run, target)
    settings = {
        "solver": solver,
        "loss": loss,
        "search": search.value if search else None,
        "control_at": control_at,
    }
    fitted = runs.identify(run, settings, session.context("identify"), force=force)
    data["identify"] = show_model(session, fitted)
    if runs.diagnosable(fitted.artifact) or nominal or calibration:
        context = session.context("diagnose")
        found = runs.diagnose(run, {}, context, nominal, calibration, force)
        data["diagnose"] = show_diagnosis(session, found)
    if target or runs.controllable(fitted.artifact):
        moved = runs.control_by(run, loss, session.context("control"), force, target)
        data["control"] = show_control(session, moved)
    data["report"] = show_report(session, run, [], force)
    session.result(data | {"answer": show_answer(session, run)})


def show_answer(session: Session, run: Path) -> list[str]:
    """Print the answer and what stands under it, and return the sentences."""
    from ropefit.adapters.contents import read_run
    from ropefit.reporting.answer import answer

    sentences = answer(read_run(run))
    session.answer(sentences)
    return sentences
