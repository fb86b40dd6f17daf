"""A rerun recording (.rrd): every frame of a run, with a time line by frame and by seconds."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ropefit.errors import StageFailed, WrongUsage
from ropefit.reporting.contents import RunContents
from ropefit.viewing.layers import Layer, frames


def write_rerun(run: RunContents, out: Path) -> Path:
    """Write the file. Raises StageFailed where rerun is missing or it cannot be written."""
    try:
        import rerun
    except ImportError:
        raise StageFailed(
            "rerun is not installed; run pip install 'ropefit[rerun]', or take --serve with "
            "'ropefit[viser]'"
        )
    if out.is_dir():
        raise WrongUsage(f"{out}: is a folder; give a file as --out")
    o = run.observations
    stream = rerun.RecordingStream("ropefit", recording_id=o.recording)
    partial = out.with_name(f".{out.name}.partial")
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        stream.save(str(partial))
        stream.log("rope", _up(rerun, o.gravity), static=True)
        for frame, time, layers in frames(run):
            stream.set_time("frame", sequence=frame)
            stream.set_time("time", duration=time)
            for layer in layers:
                stream.log(f"rope/{layer.name.replace(' ', '_')}", _shown(rerun, layer))
            if run.fitted is not None:
                t = int(np.flatnonzero(o.frames == frame)[0])
                stream.log("rms_mm/before", rerun.Scalars([1e3 * run.fitted.rms_initial[t]]))
                stream.log("rms_mm/after", rerun.Scalars([1e3 * run.fitted.rms[t]]))
        stream.flush()
        stream.disconnect()
        partial.replace(out)
    except OSError as error:
        raise StageFailed(f"cannot write {out}: {error.strerror or error}; give another --out")
    finally:
        partial.unlink(missing_ok=True)
    return out


def _shown(rerun, layer: Layer):
    if layer.line:
        strips = [layer.points] if len(layer.points) else []
        return rerun.LineStrips3D(strips, colors=[layer.colour], radii=[layer.radius])
    return rerun.Points3D(layer.points, colors=[layer.colour], radii=[layer.radius])


def _up(rerun, gravity: np.ndarray):
    """Log which axis points upwards, as far as an axis does."""
    k = int(np.argmax(np.abs(gravity)))
    names = (("RIGHT_HAND_X_DOWN", "RIGHT_HAND_X_UP"), ("RIGHT_HAND_Y_DOWN", "RIGHT_HAND_Y_UP"))
    names += (("RIGHT_HAND_Z_DOWN", "RIGHT_HAND_Z_UP"),)
    return getattr(rerun.ViewCoordinates, names[k][int(gravity[k] <= 0)])
