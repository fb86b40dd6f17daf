"""Numbers and names as a reader wants to see them. SI in, text out."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable

import numpy as np
from markupsafe import Markup

from ropefit.artifacts.causes import Size

LEAST_PLAIN, MOST_PLAIN = 1e-3, 1e5  # numbers that are written without a power of ten
FEW, REGULAR = 8, 0.8  # numbers that are listed; share of equal steps
POWERS_SHARED = 2  # powers of ten that numbers which are compared may lie apart to share one


def number(value: float | None, digits: int = 3, power: int | None = None) -> str:
    """Return a number to `digits` significant digits; a dash when it is not known.

    power: that of ten it is written with, see `common_power`; by default its own, if any.
    """
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0:
        return "0"
    exponent = int(f"{value:.{digits - 1}e}".split("e")[1])
    if power is None:
        power = 0 if LEAST_PLAIN <= abs(value) < MOST_PLAIN else exponent
    decimals = digits - 1 - (exponent - power)
    text = f"{round(value / 10.0**power, decimals):.{max(decimals, 0)}f}"
    return (f"{text}·10{_superscript(power)}" if power else text).replace("-", "−")


def common_power(values: Iterable[float]) -> int | None:
    """Return the power of ten to write numbers with that are compared; None: each with its own."""
    sizes = [abs(v) for v in values if math.isfinite(v) and v != 0]
    if not sizes or (min(sizes) >= LEAST_PLAIN and max(sizes) < MOST_PLAIN):
        return None
    powers = [math.floor(math.log10(v)) for v in sizes]
    return max(powers) if max(powers) - min(powers) <= POWERS_SHARED else None


def _superscript(exponent: int) -> str:
    return str(exponent).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def given(value: float, unit: str = "") -> str:
    """Return a number that somebody chose: no more digits than it has."""
    return f"{value:.4g} {unit}".rstrip().replace("-", "−")


def millimetres(metres: float | None, digits: int = 2) -> str:
    """Return a distance in mm."""
    return f"{number(None if metres is None else metres * 1e3, digits)} mm"


def metres(value: float) -> str:
    """Return a given length in m, or in mm when it is short."""
    return given(value, "m") if value >= 0.1 or value == 0 else given(1e3 * value, "mm")


def percent(share: float, digits: int = 2) -> str:
    """Return a share as a percentage."""
    return f"{number(100 * share, digits)} %"


def digits_of(interval: tuple[float, float] | None, least: int = 4, most: int = 8) -> int:
    """Return significant digits that tell the two sides of an interval apart."""
    if interval is None or interval[0] == interval[1] or not all(map(math.isfinite, interval)):
        return least
    ratio = max(map(abs, interval)) / abs(interval[1] - interval[0])
    return min(most, max(least, 2 + math.ceil(math.log10(ratio))))


def plural(count: int, noun: str) -> str:
    """Return '1 frame', '2 frames'."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def listed(items: Iterable[object]) -> Markup:
    """Return 'a, b and c', escaped."""
    parts = [Markup("{}").format(item) for item in items]
    if len(parts) < 2:
        return Markup("").join(parts)
    return Markup(", ").join(parts[:-1]) + Markup(" and ") + parts[-1]


def ranges(numbers: Iterable[int]) -> str:
    """Return '0–17, 20, 22–35'; of regular ones, as of every fourth, '4–148, 154–298 by 4'."""
    every = sorted(int(n) for n in numbers)
    steps = np.diff(every)
    usual = int(np.median(steps)) if len(every) > FEW else 1
    by = usual if usual > 1 and (steps == usual).mean() > REGULAR else 1
    runs: list[list[int]] = []
    for value in every:
        if runs and value == runs[-1][1] + by:
            runs[-1][1] = value
        else:
            runs.append([value, value])
    text = ", ".join(str(a) if a == b else f"{a}–{b}" for a, b in runs)
    return text if by == 1 else f"{text} by {by}"


def blocks(mask: np.ndarray) -> list[tuple[int, int]]:
    """Return (first, last) index of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def symbol(name: str) -> Markup:
    """Return a parameter's symbol: eta_x_G becomes η with x below and G above; other names stay."""
    match = re.fullmatch(r"eta_([A-Za-z]+)(?:_([A-Za-z]+))?(?:_(\d+))?", name)
    if not match:
        return Markup("{}").format(name)
    below, above, side = match.groups()
    below += f",{side}" if side else ""
    return Markup("η<sub>{}</sub>").format(below) + (
        Markup("<sup>{}</sup>").format(above) if above else Markup("")
    )


def unit_text(unit: str) -> str:
    """Return a unit with its powers set: 'N m^2' becomes 'N·m²'; nothing for the unit of a
    share."""
    if unit == "1":
        return ""
    return re.sub(r"\^(-?\d+)", lambda m: _superscript(int(m.group(1))), unit).replace(" ", "·")


def with_unit(text: str, unit: str) -> str:
    """Return a number, an interval or a name with its unit behind it, if it has one."""
    return f"{text} {unit_text(unit)}".rstrip()


READABLE = {"m": (1e3, "mm"), "kg": (1e3, "g"), "rad": (180 / math.pi, "°"), "s": (1e3, "ms")}


def in_use(
    value: float, ci95: tuple[float, float], unit: str
) -> tuple[float, tuple[float, float], str]:
    """Return a number and its interval in the unit that a person would use: grams, mm, degrees."""
    factor, unit = READABLE.get(unit, (1.0, unit))
    return factor * value, (factor * ci95[0], factor * ci95[1]), unit


def readable(size: Size) -> str:
    """Return a size in the unit that a person would use."""
    value, _, unit = in_use(size.value, size.ci95, size.unit)
    return f"{number(value)}°" if unit == "°" else with_unit(number(value), unit)


def strength(nats: float, threshold: float) -> str:
    """Return evidence in words: a ratio of odds of 100 (Jeffreys) beyond what chance reaches
    here."""
    if nats >= threshold + math.log(100):
        return "decisive"
    if nats >= threshold:
        return "strong"
    return "weak" if nats > 0 else "against it"


def slug(title: str) -> str:
    """Return a title as an anchor."""
    return re.sub(r"[^a-z0-9]+", "-", title.lower()).strip("-")
