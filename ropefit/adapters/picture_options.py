"""What a person says on the command line about the rope in the pictures, as settings."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ropefit.errors import WrongUsage


def picture_settings(color: str | None, roi: str | None, mask: Path | None) -> dict[str, Any]:
    """Settings of preprocess from `--color`, `--roi` and `--mask`. Raises WrongUsage."""
    rgb = box = None
    if color is not None:
        text = color.strip()
        if re.fullmatch("#[0-9a-fA-F]{6}", text):
            rgb = [int(text[i : i + 2], 16) for i in (1, 3, 5)]
        else:
            rgb = _whole(text)
        if len(rgb) != 3 or not all(0 <= value <= 255 for value in rgb):
            raise WrongUsage(f"--color {color!r}: expected r,g,b of 0..255 or #rrggbb")
    if roi is not None:
        box = _whole(roi)
        if len(box) != 4 or min(box) < 0 or min(box[2:]) < 1:
            raise WrongUsage(f"--roi {roi!r}: expected u,v,width,height [px], a size above 0")
    return {"color": rgb, "roi": box, "mask": None if mask is None else str(mask.resolve())}


def _whole(text: str) -> list[int]:
    """Comma-separated whole numbers; an empty list where it is something else."""
    parts = [part.strip() for part in text.split(",")]
    return [int(part) for part in parts] if all(p.isdecimal() for p in parts) else []
