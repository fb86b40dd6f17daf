"""The stages as functions, for use from Python: artifacts in, an artifact out, nothing on disk.

What comes out is what the command line would write: `save` puts it into a run directory, where
every command goes on with it. SI units; shapes stand in the schemas (`ropefit.artifacts`). All
failures are `ropefit.errors.RopefitError`, reported in one line.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from ropefit.adapters.contents import read_run
from ropefit.adapters.control_settings import ControlSettings
from ropefit.adapters.settings import (
    NOMINAL_DIAGNOSIS,
    NOMINAL_OBSERVATIONS,
    DiagnoseSettings,
    PreprocessSettings,
)
from ropefit.api import pipeline
from ropefit.api.keywords import checked_settings
from ropefit.artifacts import (
    Artifact,
    Control,
    Diagnosis,
    Model,
    Observations,
    content_sha256,
    write,
)
from ropefit.errors import BadInput, WrongUsage
from ropefit.fitting.settings import IdentifySettings
from ropefit.recordings import Masks, Recording, fingerprint, open_recording, sample_path
from ropefit.reporting.contents import RunContents as Run
from ropefit.runs.execute import made
from ropefit.runs.protocol import Context, Stage, StageSettings
from ropefit.runs.run_directory import existing_run, new_run

if TYPE_CHECKING:
    from ropefit.exporters import ExportResult

__all__ = [
    "Run",
    "control",
    "diagnose",
    "export",
    "fit",
    "load",
    "open_run",
    "preprocess",
    "report",
    "sample",
    "save",
]

Progress = Callable[[float, str], None]


def sample(name: Literal["cloud", "rgbd", "markers"] = "cloud") -> Path:
    """Return the directory of a packaged sample recording.

    >>> sample("markers").name
    'markers'
    """
    return sample_path(name)


def load(path: str | Path) -> Recording:
    """Return a recording directory (docs/recording-format.md); frames are read when they are
    needed.

    >>> load(sample("markers")).frames[:3]
    [0, 1, 2]
    """
    return open_recording(Path(path))


def preprocess(
    recording: Recording | str | Path,
    *,
    nodes: int = 20,
    project: Literal["auto", "yes", "no"] = "auto",
    most_points: int = 400,
    color: tuple[int, int, int] | None = None,
    roi: tuple[int, int, int, int] | None = None,
    mask: str | Path | None = None,
    progress: Progress | None = None,
) -> Observations:
    """Return ordered centrelines with a measured noise, frame by frame.

    nodes: K points along the rope; color (r, g, b), roi (u, v, width, height) [px] and mask (a
    folder) help to find the rope in pictures. Raises BadInput when no frame is usable.
    """
    opened = recording if isinstance(recording, Recording) else load(recording)
    settings = checked_settings(
        PreprocessSettings,
        nodes=nodes,
        project=project,
        most_points=most_points,
        color=color,
        roi=roi,
        mask=None if mask is None else str(mask),
    )
    hashes = {"recording": fingerprint(opened)}
    if mask is not None:
        hashes["mask"] = Masks(Path(mask)).sha256()
    return _compute(pipeline.PREPROCESS, {}, hashes, settings, {"recording": opened}, progress)


def fit(
    observations: Observations,
    *,
    free: Sequence[str] | str | None = None,
    start: dict[str, float] | None = None,
    known: Model | None = None,
    solver: Literal["equilibrium", "thomas", "jacobi"] = "equilibrium",
    loss: str = "OBJ1",
    search: Literal["least-squares", "gradient", "grid"] | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Model:
    """Return the parameters that make simulation and observations agree: EI [N m²] and what `free`
    names besides (EI, GJ, EA, length; one text has commas between), each with its interval and
    verdict.

    start: SI values to start from; known: a model of the same rope whose parameters are kept;
    settings: any other option of `ropefit identify`, with underscores. A frame that does not settle
    is marked. Raises BadInput, NotConverged, WrongUsage.
    """
    chosen = checked_settings(
        IdentifySettings,
        solver=solver,
        loss=loss,
        search=search,
        free=free.split(",") if isinstance(free, str) else None if free is None else list(free),
        start=start or {},
        from_run=known is not None,
        **settings,
    )
    hashes, external = _of(observations), {}
    if known is not None:
        hashes["--from"] = content_sha256(known)
        external = {"from": known, "from_path": "the known model"}
    return _compute(pipeline.IDENTIFY, _inputs(observations), hashes, chosen, external, progress)


def diagnose(
    observations: Observations,
    model: Model,
    *,
    nominal: Model | None = None,
    nominal_diagnosis: Diagnosis | None = None,
    nominal_observations: Observations | None = None,
    calibration: Model | None = None,
    simulation: Observations | None = None,
    progress: Progress | None = None,
    **settings: Any,
) -> Diagnosis:
    """Return where data and model differ beyond noise, and which effects explain it
    (docs/diagnosis.md).

    nominal: the same rope's model from another recording, taken as known, and nominal_diagnosis:
    what was found there, of which all that belongs to the rope is taken over; nominal_observations:
    that recording, of which a motion needs the gravity that is told there; calibration: the
    model of another recording of the same set-up, for its camera and gravity; simulation: what
    preprocess makes of another simulator's recording of the same motion. settings: any other of
    `ropefit diagnose`. Raises BadInput, NotConverged, WrongUsage.
    """
    given = {"nominal": nominal, "calibration": calibration, "simulation": simulation}
    external = {name: other for name, other in given.items() if other is not None}
    chosen = checked_settings(DiagnoseSettings, **dict.fromkeys(external, True), **settings)
    besides = {NOMINAL_DIAGNOSIS: nominal_diagnosis, NOMINAL_OBSERVATIONS: nominal_observations}
    external |= {name: other for name, other in besides.items() if other is not None}
    hashes = _of(observations, model)
    hashes |= {name: content_sha256(other) for name, other in external.items()}
    return _compute(
        pipeline.DIAGNOSE, _inputs(observations, model), hashes, chosen, external, progress
    )


def control(
    observations: Observations,
    model: Model,
    *,
    diagnosis: Diagnosis | None = None,
    targets: np.ndarray | None = None,
    arc_length: np.ndarray | None = None,
    loss: str = "OBJ1",
    progress: Progress | None = None,
    **settings: Any,
) -> Control:
    """Return where the gripper was in every frame, or, with targets, where it must go.

    diagnosis: the rope then has what was found to be left out.
    targets (M, 3) or (C, M, 3) [m]: points that the rope is to pass, of C shapes; arc_length (M,)
    or (C, M) [m]: where on the rope, NaN or None for anywhere. settings: any other option of
    `ropefit control`. `converged` marks the searches that arrived. Raises BadInput, NotConverged.
    """
    external: dict[str, Any] = {}
    hashes = _of(observations, model)
    if diagnosis is not None:
        hashes[Diagnosis.file_name] = content_sha256(diagnosis)
        external["diagnosis"] = diagnosis
    if targets is not None:
        wanted = _targets(targets, arc_length, observations.length)
        hashes["target"] = wanted.sha256
        external["targets"] = wanted
    chosen = checked_settings(ControlSettings, loss=loss, target=targets is not None, **settings)
    return _compute(
        pipeline.CONTROL, _inputs(observations, model), hashes, chosen, external, progress
    )


def export(
    observations: Observations,
    model: Model,
    to: str,
    *,
    diagnosis: Diagnosis | None = None,
    mass: float | None = None,
) -> ExportResult:
    """Return the identified rope as text for a simulator: mujoco, mujoco3, newton, pyelastica or
    json.

    diagnosis: what was found goes along where the target can express it. mass [kg] of the whole
    rope, if the recording does not say it. Raises WrongUsage, NotConverged.
    """
    from ropefit.stages.export import export_run

    return export_run(observations, model, diagnosis, to, mass).result


def report(
    observations: Observations,
    model: Model | None = None,
    diagnosis: Diagnosis | None = None,
    control: Control | None = None,
) -> str:
    """Return the report as one offline HTML page."""
    from ropefit.reporting.report import render_report

    return render_report(Run(observations, model, control, diagnosis))


def save(directory: str | Path, *artifacts: Artifact) -> Path:
    """Write artifacts into a run directory, where the command line goes on with them.

    Raises StageFailed where that cannot be written.
    """
    run = new_run(Path(directory))
    run.mkdir(parents=True, exist_ok=True)
    for artifact in artifacts:
        write(run / artifact.file_name, artifact)
    return run


def open_run(directory: str | Path) -> Run:
    """Return everything a run directory holds. Raises StageFailed when stale or missing, BadInput
    when damaged."""
    return read_run(existing_run(Path(directory)))


def _compute(
    stage: Stage[Any],
    inputs: dict[str, Any],
    hashes: dict[str, str],
    settings: StageSettings,
    external: dict[str, Any],
    progress: Progress | None,
) -> Any:
    context = Context(external=external)
    if progress is not None:
        context.progress = progress
    return made(stage, inputs, hashes, settings, context)


def _inputs(*artifacts: Artifact) -> dict[str, Artifact]:
    return {artifact.file_name: artifact for artifact in artifacts}


def _of(*artifacts: Artifact) -> dict[str, str]:
    return {artifact.file_name: content_sha256(artifact) for artifact in artifacts}


def _targets(points: np.ndarray, arc: np.ndarray | None, length: float) -> Any:
    from ropefit.adapters.targets import Targets

    points = np.asarray(points, dtype=float)
    points = points[None] if points.ndim == 2 else points
    if points.ndim != 3 or points.shape[2] != 3 or not np.isfinite(points).all():
        raise WrongUsage(f"targets {points.shape}: expected finite numbers (M, 3) or (C, M, 3)")
    places = np.full(points.shape[:2], np.nan)
    if arc is not None:
        try:
            places[:] = np.asarray(arc, dtype=float)
        except ValueError:
            raise WrongUsage(f"arc_length {np.shape(arc)}: expected one number a target point")
    if np.any((places < 0) | (places > length)):
        raise BadInput(f"arc_length outside the rope (0 to {length:g} m)")
    digest = hashlib.sha256(points.tobytes() + places.tobytes()).hexdigest()
    return Targets(np.arange(len(points)), points, places, digest)
