"""A law that was found, in the units in which a run states its parameters."""

from __future__ import annotations

from ropefit.adapters.units import stated_units
from ropefit.artifacts import Observations
from ropefit.artifacts.causes import Curve, Law, Size
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.forms import Described, described
from ropefit.effects import Effect
from ropefit.effects.law import Law as FreeLaw
from ropefit.inference.least_squares import Fit


def law_of(o: Observations, candidate: Candidate, final: Fit) -> tuple[Law, str] | None:
    """Return what is known of an accepted law, and that in words; None of any other effect."""
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
            value=times * float(c.value), unit=c.unit or times_metre(of, c.power),
            ci95=(times * low, times * high),
        )  # fmt: skip
    out = Law(form=forms[0] if found.named else "", forms=forms, parameters=parameters, curve=curve)
    return out, _sentence(out, law)


def constant_law(effect: Effect, parameters: dict[str, Size]) -> Law | None:
    """Return the law of an effect that has one without a variable, by the sizes of the effect."""
    if not effect.constant:
        return None
    names = {q.name for q in effect.quantities} | {(effect.vector or ("",))[0]}
    own = {name: size for name, size in parameters.items() if name in names}
    return Law(
        form=effect.constant, forms=[effect.constant], parameters=own, no_curve=effect.no_curve
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
    return {"m^-1": "1/m", "N m^-1": "N/m"}.get(out, out)


def _sentence(law: Law, found: FreeLaw) -> str:
    """Return the answer in words: the curve at both ends of what is visited, and its form."""
    c = law.curve
    assert c is not None
    ends = c.x.searchsorted(c.visited).clip(max=len(c.x) - 1)
    sentence = found.sentence(c.x[ends], c.y[ends], (c.unit_x, c.unit_y))
    numbers = ", ".join(
        f"{name} = {s.value:.3g} ({s.ci95[0]:.3g} to {s.ci95[1]:.3g})"
        + ("" if s.unit == "1" else f" {s.unit}")
        for name, s in law.parameters.items()
    )
    if law.form:
        return f"{sentence}: {law.form}, {numbers}"
    if law.forms:
        return f"{sentence}; its form may be {' or '.join(law.forms)}"
    return f"{sentence}; no known form follows its curve"
