"""The texts of options as values. All raise WrongUsage."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ropefit.errors import WrongUsage


def picture_settings(color: str | None, roi: str | None, mask: Path | None) -> dict[str, Any]:
    """Return the settings of preprocess from `--color`, `--roi` and `--mask`."""
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
    """Return comma-separated whole numbers; an empty list where it is something else."""
    parts = [part.strip() for part in text.split(",")]
    return [int(part) for part in parts] if all(p.isdecimal() for p in parts) else []


def numbers(option: str, text: str, count: int) -> list[float]:
    """Return `count` comma-separated numbers."""
    try:
        values = [float(item) for item in text.split(",")]
    except ValueError:
        values = []
    if len(values) != count:
        raise WrongUsage(f"{option} {text!r}: expected {count} numbers with commas between")
    return values


def starts(items: list[str]) -> dict[str, float]:
    """Return the values of `--start NAME=VALUE`."""
    out = {}
    for item in items:
        name, _, value = item.partition("=")
        try:
            out[name.strip()] = float(value)
        except ValueError:
            raise WrongUsage(f"--start {item!r}: expected NAME=VALUE with a number")
    return out


def named_texts(items: list[str]) -> dict[str, str]:
    """Return the texts of `--set NAME=VALUE`; the last of one name counts."""
    out = {}
    for item in items:
        name, equals, value = item.partition("=")
        if not equals or not name.strip():
            raise WrongUsage(f"--set {item!r}: expected NAME=VALUE")
        out[name.strip()] = value.strip()
    return out


def gravity(text: str) -> tuple[float, float, float]:
    """Return the vector of `--gravity x,y,z`."""
    try:
        x, y, z = (float(item) for item in text.split(","))
    except ValueError:
        raise WrongUsage(f"--gravity {text}: expected x,y,z")
    return x, y, z
