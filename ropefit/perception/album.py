"""Pictures that show a person what was taken for the rope, and why."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ropefit.errors import StageFailed
from ropefit.perception.segment import Segmentation
from ropefit.perception.trace import Trace
from ropefit.perception.tracing import Tracer
from ropefit.recordings import Recording

MOST_PICTURES = 6  # pictures kept for the report
LARGEST = 1000  # px, of their longer side
SEEN, UNSEEN, TIP = (40, 40, 230), (230, 160, 30), (60, 200, 60)  # BGR
QUALITY = 80  # of JPEG


class Album:
    """Keeps a few pictures with the path drawn in; writes all steps of all frames to a folder."""

    def __init__(self, recording: Recording, tracer: Tracer, folder: Path | None):
        self.tracer = tracer
        self.folder = folder
        self.kept: dict[int, tuple[bytes, str]] = {}
        frames = np.array(recording.frames)
        at = np.linspace(0, len(frames) - 1, min(MOST_PICTURES, len(frames))).round().astype(int)
        self.chosen = set(frames[np.unique(at)].tolist())
        if folder is not None:
            try:
                folder.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise StageFailed(f"{folder}: cannot be made ({error.strerror}); give another")

    def look(
        self,
        frame: int,
        color: np.ndarray,
        depth: np.ndarray | None,
        trace: Trace,
        found: Segmentation,
    ) -> None:
        """Take note of one frame (see Tracer.trace)."""
        if frame not in self.chosen and self.folder is None:
            return
        drawn = drawing(color, found)
        if frame in self.chosen:
            good, data = cv2.imencode(".jpg", drawn, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
            if good:
                self.kept[frame] = (data.tobytes(), caption(found, trace))
        if self.folder is not None:
            name = f"{frame:06d}"
            self._write(f"{name}_1_picture.jpg", np.ascontiguousarray(color[..., ::-1]))
            self._write(f"{name}_2_mask.png", found.mask.astype(np.uint8) * 255)
            self._write(f"{name}_4_path.jpg", drawn)
            if depth is not None:
                self._write(f"{name}_3_depth.png", depth_picture(depth, found.path))
            (self.folder / f"{name}_why.txt").write_text(reasons(found, trace))

    def reject(self, frame: int, reason: str) -> None:
        """Take note of a frame that is not used."""
        if self.folder is not None:
            (self.folder / f"{frame:06d}_why.txt").write_text(f"dropped: {reason}\n")

    def pictures(self) -> dict[str, Any]:
        """Return what observations keep: JPEG files one after the other, where each begins,
        frames."""
        if not self.kept:
            return {}
        frames = sorted(self.kept)
        data = [np.frombuffer(self.kept[frame][0], np.uint8) for frame in frames]
        return {
            "pictures": np.concatenate(data),
            "picture_start": np.concatenate([[0], np.cumsum([len(d) for d in data])]).astype(int),
            "picture_frame": np.array(frames),
            "picture_text": [self.kept[frame][1] for frame in frames],
        }

    def _write(self, name: str, image: np.ndarray) -> None:
        assert self.folder is not None
        path = self.folder / name
        if not cv2.imwrite(str(path), image):
            raise StageFailed(f"{path}: cannot be written; give another --debug-images")


def drawing(color: np.ndarray, found: Segmentation) -> np.ndarray:
    """Return a picture (h, w, 3) uint8 BGR, not too large, with the path drawn in: red where the
    rope was seen, blue where it was not, rings at its ends."""
    shrink = -(-max(color.shape[:2]) // LARGEST)
    size = (max(color.shape[1] // shrink, 1), max(color.shape[0] // shrink, 1))
    out = cv2.resize(np.ascontiguousarray(color[..., ::-1]), size, interpolation=cv2.INTER_AREA)
    path = (found.path + 0.5) / shrink - 0.5
    fixed = np.round(path * 16).astype(np.int32)
    for i in range(len(path) - 1):
        shade = SEEN if found.seen[i] and found.seen[i + 1] else UNSEEN
        cv2.line(out, fixed[i].tolist(), fixed[i + 1].tolist(), shade, 1, cv2.LINE_AA, 4)
    for tip in fixed[[0, -1]]:
        cv2.circle(out, tip.tolist(), 6 * 16, TIP, 1, cv2.LINE_AA, 4)
    return out


def depth_picture(depth: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Return depth (H, W) [m] in false colours about the rope's, black where there is none."""
    at = np.round(path).astype(int)
    at = np.clip(at, 0, [depth.shape[1] - 1, depth.shape[0] - 1])
    on = depth[at[:, 1], at[:, 0]]
    middle = float(np.median(on[on > 0])) if (on > 0).any() else float(np.median(depth))
    low, high = 0.7 * middle, 1.5 * middle + 1e-6
    grey = np.clip((depth - low) / (high - low) * 255, 0, 255).astype(np.uint8)
    out = cv2.applyColorMap(255 - grey, cv2.COLORMAP_TURBO)
    out[depth <= 0] = 0
    return out


def caption(found: Segmentation, trace: Trace) -> str:
    """Draw one line under a picture."""
    return (
        f"taken for the rope: {found.cue}; confidence {found.confidence:.2f}, "
        f"{found.width:.1f} px wide, {found.pieces} piece{'s' if found.pieces != 1 else ''}, "
        f"seen along {found.seen.mean():.0%} of its path; quality {trace.quality:.2f}"
        f"{'; something else in the picture is as much like a rope' if found.several else ''}"
    )


def reasons(found: Segmentation, trace: Trace) -> str:
    """Return what decided, for a person who looks for a mistake."""
    lines = [caption(found, trace), f"score {found.score:.4f}", "other candidates:"]
    lines += [f"  {score:.4f} {cue}" for cue, score in found.runners_up] or ["  none"]
    return "\n".join(lines) + "\n"
