"""Another simulation of the same motion: which rope it is, and what it lacks."""

from __future__ import annotations

from markupsafe import Markup

from ropefit.artifacts import Diagnosis
from ropefit.artifacts.causes import Size
from ropefit.artifacts.diagnosis import Simulation
from ropefit.reporting.contents import RunContents
from ropefit.reporting.html import bullets, facts, paragraph, table
from ropefit.reporting.sections.base import Section
from ropefit.reporting.words import listed, millimetres, number, symbol, with_unit


class SimulationSection(Section):
    """The distances of simulation, recording and models; the rope of both; what is missing."""

    title = "Simulation"

    def applies(self, run: RunContents) -> bool:
        return run.diagnosis is not None and run.diagnosis.simulation is not None

    def render(self, run: RunContents) -> Markup:
        d = run.diagnosis
        assert d is not None
        assert d.simulation is not None
        s = d.simulation
        return (
            paragraph(_lacks(s))
            + facts(_distances(d, s))
            + table(["parameter", "recording", "simulation"], _rows(d.rope, s.rope))
            + bullets(_notes(s))
        )


def _lacks(s: Simulation) -> Markup:
    lacks = listed(name.replace("_", " ") for name in s.missing)
    return Markup("{} lacks {}.").format(_capital(s.name), lacks or "nothing that was found")


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _distances(d: Diagnosis, s: Simulation) -> dict[str, str]:
    """Return rms distances of what is compared."""
    own = {
        "Simulation from the recording": s.rms,
        "Nominal rope from the recording": s.rms_converged,
        "That rope with the causes": d.rms_after,
        "Noise of a point": d.noise_white,
        "Nominal rope from the simulation": s.rms_of_rope,
        "That rope with the simulation’s effects": s.rms_explained,
    }
    return {name: millimetres(rms) for name, rms in own.items()}


def _rows(real: dict[str, Size], simulated: dict[str, Size]) -> list[list[object]]:
    """Return a row a parameter that either rope has: its values and 95 % intervals."""
    names = [*real, *(name for name in simulated if name not in real)]
    return [
        [symbol(name), *(_value(rope.get(name)) for rope in (real, simulated))] for name in names
    ]


def _value(size: Size | None) -> str:
    if size is None:
        return "–"
    low, high = size.ci95
    return with_unit(f"{number(size.value)} ({number(low)} … {number(high)})", size.unit)


def _notes(s: Simulation) -> list[str]:
    """Return what the simulation has besides, and what differs in size."""
    has = [f"In the simulation: {cause.sentence}." for cause in s.effects.values()]
    if s.verdict == "unknown":
        has.append("The simulation does something that no effect of the catalogue explains.")
    differ = [f"{_capital(text)}." for text in s.differences]
    return has + differ + [f"In the simulation, refused: {text}." for text in s.refused]
