"""A law that was found, in the units in which a run states its parameters."""

from __future__ import annotations

from ropefit.adapters.units import stated_units
from ropefit.artifacts import Observations
from ropefit.artifacts.diagnosis import Curve, Law, Size
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.forms import Described, described
from ropefit.inference.least_squares import Fit


def law_of(o: Observations, candidate: Candidate, final: Fit) -> Law | None:
    """Return what is known of an accepted law; None of any other effect."""
    found = described(candidate, final)
    if found is None:
        return None
    factor, unit, _ = stated_units(o)["EI"]
    law = found.law
    curve = Curve(
        x=found.x, y=factor * found.y, low=factor * found.low, high=factor * found.high,
        unit_x=law.unit_x, unit_y=times_metre(unit, law.power_y), name_x=law.x, name_y=law.y,
        visited=found.visited,
    )  # fmt: skip
    forms = [f.form.name for f in found.forms]
    parameters = {}
    for c, (low, high) in zip(*_constants(found), strict=True):
        times, of = (factor, unit) if c.of_ei else (1.0, "")
        parameters[c.name] = Size(
            value=times * float(c.value), unit=times_metre(of, c.power),
            ci95=(times * low, times * high),
        )  # fmt: skip
    return Law(
        form=forms[0] if found.named else "", forms=forms, parameters=parameters, curve=curve
    )


def _constants(found: Described):
    best = found.forms[:1]
    return [c for f in best for c in f.constants], [ends for f in best for ends in f.intervals]


def times_metre(unit: str, power: float) -> str:
    """Return a unit times metre to a power: "N m^2" and -1 give "N m"."""
    *before, last = unit.split(" ") if unit else [""]
    if last.startswith("m"):
        power += float(last.removeprefix("m").removeprefix("^") or 1)
    elif last:
        before.append(last)
    metres = [] if power == 0 else ["m" if power == 1 else f"m^{power:.3g}"]
    out = " ".join([*before, *metres]).strip() or "1"
    return "1/m" if out == "m^-1" else out


def sentence_of(law: Law) -> str:
    """Return the answer in words: which way the law departs from a straight line, and its form."""
    c = law.curve
    first, last = (c.x.searchsorted(x) for x in c.visited)
    ratio = float(c.y[last] / c.x[last] / (c.y[first] / c.x[first]))
    way = "softens" if ratio < 1 else "stiffens"
    told = (
        f"bending {way}: the {c.name_y} per {c.name_x} at {c.x[last]:.2g} {c.unit_x} is "
        f"{ratio:.2g} times that at {c.x[first]:.2g} {c.unit_x}"
    )
    numbers = ", ".join(
        f"{name} = {s.value:.3g} ({s.ci95[0]:.3g} to {s.ci95[1]:.3g})"
        + ("" if s.unit == "1" else f" {s.unit}")
        for name, s in law.parameters.items()
    )
    if law.form:
        return f"{told}: {law.form}, {numbers}"
    if law.forms:
        return f"{told}; its form may be {' or '.join(law.forms)}"
    return f"{told}; no known form follows its curve"
