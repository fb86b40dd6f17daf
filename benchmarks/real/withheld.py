"""Causes withheld on measured ropes in motion: each must be named again, with its size.

A run on some clips, identified and diagnosed, is the nominal rope (`--nominal`). Other clips tell
one thing falsely, or the nominal run has one thing taken away: the noise is real, the truth exact.
"""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.command import CommandFailed, processor_time, ropefit
from benchmarks.discovery.run import kept
from benchmarks.real.falsehoods import FALSEHOODS, Falsehood, Told
from benchmarks.real.motion import clips_of, join
from ropefit.adapters.taken_over import as_found
from ropefit.adapters.units import stated_units
from ropefit.artifacts import Diagnosis, Model, Observations, read, write

CLIPS = 12  # of each recording: the nominal run's, and the others'
WHOLE = 500  # frames of a clip of the nominal run: a rope at hand may be recorded for long
FRAMES = 200  # of a clip of the others
HELD = ("--holdout", "0")
VISIBLE = 6.0  # score: the least at which blind recordings are made


@dataclass(frozen=True)
class Case:
    """A thing withheld: what is told falsely, which parameters of the rope are frozen at nothing,
    and whether the nominal run's own causes are."""

    falsehood: Falsehood | None = None
    undamped: bool = False
    undiagnosed: bool = False


CASES: dict[str, Case] = {
    "rest curvature": Case(undiagnosed=True),
    "damping": Case(undamped=True),
    **{name: Case(falsehood) for name, falsehood in FALSEHOODS.items()},
}
DAMPINGS = ("bend_damping", "air_damping")


def withheld(source: Path, folder: Path, gravity: str) -> dict[str, dict[str, Any]]:
    """Return what is found of each cause withheld from a rope; gravity: the one of `FALSEHOODS` in
    it that is put into this rope. What folder holds already is not computed again."""
    clips = clips_of(source, "train")
    few = [clips[k] for k in np.linspace(0, len(clips) - 1, 2 * CLIPS).round().astype(int)]
    nominal, others = folder / "nominal", few[1::2]
    known = kept(
        folder / "nominal.json", lambda: _diagnosed(source, few[::2], nominal, None, frames=WHOLE)
    )
    out = {"nothing": known}
    for what, case in CASES.items():
        if what.startswith("gravity") and what != gravity:
            continue
        run = folder / what.replace(" ", "-").replace("/", "-per-")
        out[what] = kept(
            run.with_suffix(".json"),
            lambda c=case, r=run: _case(c, source, others, r, nominal, known["answer"]),
        )
    return out


def _case(
    case: Case, source: Path, clips: list[Path], run: Path, nominal: Path, known: dict[str, Any]
) -> dict[str, Any]:
    """Return the answer of one case, with what is true."""
    told = run.with_name(f"{run.name}-nominal")
    taken_away(nominal, told, case)
    out = _diagnosed(source, clips, run, case.falsehood, told, case.undamped)
    return out | {"true": _true(case, nominal, known)}


def _true(case: Case, nominal: Path, known: dict[str, Any]) -> dict[str, Any]:
    """Return the names that are right, and the sizes that are true."""
    if case.undamped:
        return {"names": ["damping"], "sizes": _damping(nominal)}
    if case.undiagnosed:
        of = next((e for e in known["effects"] if e["name"] == "rest_curve"), None)
        size = of["parameters"]["curvature"]["value"] if of else None
        return {"names": ["rest_curve"], "sizes": {"curvature": size}}
    assert case.falsehood is not None
    sizes = dict(case.falsehood.sizes)
    for effect in known["effects"]:  # what the nominal run found wrong is wrong here, too
        for key in sizes.keys() & effect["parameters"].keys():
            if effect["name"] in case.falsehood.names:
                sizes[key] = case.falsehood.beside(sizes[key], effect["parameters"][key]["value"])
    return {"names": list(case.falsehood.names), "sizes": sizes}


def _damping(nominal: Path) -> dict[str, float]:
    """Return the dampings of a run as fitted along with what was found in it, in the units of the
    effect: of a rope of unknown mass they are per kg/m, and parameters per weight."""
    model, _ = read(nominal / Model.file_name, Model)
    found, _ = read(nominal / Diagnosis.file_name, Diagnosis)
    o, _ = read(nominal / Observations.file_name, Observations)
    parameters = next(iter(as_found(model, found).nominal.groups.values())).parameters
    sizes = zip(("air", "bend"), reversed(DAMPINGS), strict=True)
    return {size: parameters[name].value / stated_units(o)[name].factor for size, name in sizes}


def taken_away(nominal: Path, target: Path, case: Case) -> None:
    """Copy a run without what a case withholds."""
    if target.exists():
        shutil.rmtree(target)
    shutil.copytree(nominal, target)
    if case.undiagnosed:
        (target / Diagnosis.file_name).unlink()
    if case.undamped:
        model, _ = read(target / Model.file_name, Model)
        fitted = model.nominal
        ((name, group),) = fitted.groups.items()
        free = {
            key: p.model_copy(update={"free": p.free and key not in DAMPINGS})
            for key, p in group.parameters.items()
        }
        groups = {name: group.model_copy(update={"parameters": free})}
        models = {"nominal": fitted.model_copy(update={"groups": groups})}
        made = write(target / Model.file_name, model.model_copy(update={"models": models}))
        _follows(target / Diagnosis.file_name, made)


def _follows(path: Path, model: str) -> None:
    """Write a diagnosis again as made from a model with that hash: else it would be stale."""
    diagnosis, _ = read(path, Diagnosis)
    inputs = diagnosis.provenance.inputs | {Model.file_name: model}
    provenance = diagnosis.provenance.model_copy(update={"inputs": inputs})
    write(path, diagnosis.model_copy(update={"provenance": provenance}))


def _diagnosed(
    source: Path, clips: list[Path], run: Path, falsehood: Falsehood | None,
    nominal: Path | None = None, undamped: bool = False, frames: int = FRAMES,
) -> dict[str, Any]:  # fmt: skip
    """Return the answer of `diagnose`, and the processor time [s] of all stages."""
    recording = run.with_name(f"{run.name}-recording")
    for path in (recording, run):
        if path.exists():
            shutil.rmtree(path)
    arc = None
    if nominal is not None:  # the markers are where the nominal run has them on the rope
        seen, _ = read(nominal / Observations.file_name, Observations)
        arc = seen.point_arc[: seen.point_start[1]]
    join(source, clips, recording, arc, frames)
    if falsehood is not None:
        Told(recording, clips=len(clips)).changed(falsehood)
    free = ("--free", "EI,GJ") if undamped else ()
    begin, seconds = processor_time(), {}
    scores: dict[str, float] = {}
    out: dict[str, Any] = {"answer": None, "error": None, "seconds": seconds, "scores": scores}
    steps = (
        ("preprocess", recording, "--run", run),
        ("identify", "--solver", "dynamics", *HELD, *free, "--run", run),
        ("diagnose", "--run", run, *(("--nominal", nominal) if nominal else ())),
    )
    for step in steps:
        try:
            out["answer"] = ropefit(*step, unconverged=True)
        except CommandFailed as error:
            return out | {"answer": None, "error": str(error)}
        seconds[step[0]] = processor_time() - begin - sum(seconds.values())
    found, _ = read(run / Diagnosis.file_name, Diagnosis)
    for one in found.scan.values():
        scores[one.name] = max(one.score, scores.get(one.name, 0.0))
    return out


def judged(found: dict[str, Any]) -> dict[str, Any]:
    """Return whether a cause is named, in a reported set at least, and its sizes in their
    intervals; the sizes as told, and the score of the right effect in the scan."""
    answer, true = found["answer"], found["true"]
    scores = (found["scores"].get(name, 0.0) for name in true["names"])
    out = {"named": False, "in_set": False, "inside": False, "told": {}, "score": max(scores)}
    for effect in answer["effects"] if answer else []:
        named = effect["name"] in true["names"]
        out["named"] |= named
        out["in_set"] |= named or bool({*effect["equivalent_to"]} & {*true["names"]})
        if named:
            told = {key: effect["parameters"].get(key) for key in true["sizes"]}
            out["told"] = told
            out["inside"] = all(
                size is not None and told[key] and within(size, told[key]["ci95"])
                for key, size in true["sizes"].items()
            )
    return out


def within(size: float, interval: list[float]) -> bool:
    low, high = interval
    return low <= size <= high


def withheld_table(found: dict[str, dict[str, dict[str, Any]]]) -> str:
    """Return the table; found: by rope, then by what is withheld."""
    whats = list(dict.fromkeys(what for one in found.values() for what in one if what != "nothing"))
    rows = [
        f"Causes withheld on these cables: {CLIPS} other training clips of {FRAMES} frames, with a",
        f"run on {CLIPS} of {WHOLE} frames, diagnosed, as `--nominal`; one thing is told falsely,",
        "or taken away from that run. **Bold**: named, and the true size in its 95 % interval",
        "(true → found). *Score*: signal to noise of the right effect in the scan, without what",
        "the rope's parameters and the grips explain. Seconds are processor time of all stages.",
        "Written by `python -m benchmarks.real --only withheld`.",
        "",
        "| withheld | " + " | ".join(found) + " |",
        "|---" * (1 + len(found)) + "|",
    ]
    cases = [(rope, what) for what in whats for rope in found if what in found[rope]]
    verdicts = {(rope, what): judged(found[rope][what]) for rope, what in cases}
    for what in whats:
        cells = [
            _cell(one[what], verdicts[rope, what]) if what in one else "-"
            for rope, one in found.items()
        ]
        rows.append(f"| {what} | " + " | ".join(cells) + " |")
    right = sum(v["named"] and v["inside"] for v in verdicts.values())
    named = sum(v["named"] for v in verdicts.values())
    visible = [v["named"] or v["in_set"] for v in verdicts.values() if v["score"] >= VISIBLE]
    rows += [
        "",
        f"Named: {named} of {len(cases)}, with the true size in its interval: {right}. Of score",
        f"{VISIBLE:g} and more: named or in the set {sum(visible)} of {len(visible)}.",
    ]
    return "\n".join(rows) + "\n"


def _cell(found: dict[str, Any], verdict: dict[str, Any]) -> str:
    """Return what was answered."""
    seconds = f"{sum(found['seconds'].values()):.0f} s"
    answer = found["answer"]
    if answer is None:
        return f"no answer: {found['error']}"
    names = ", ".join(effect["name"] for effect in answer["effects"]) or f"`{answer['verdict']}`"
    if verdict["in_set"] and not verdict["named"]:
        names += " (in the set)"
    sizes = "; ".join(
        f"{found['true']['sizes'][key]:.3g} → {t['value']:.3g} "
        f"({t['ci95'][0]:.3g} .. {t['ci95'][1]:.3g})"
        for key, t in verdict["told"].items()
        if t and found["true"]["sizes"][key] is not None
    )
    names = f"**{names}**" if verdict["named"] and verdict["inside"] else names
    score = f"score {verdict['score']:.2g}"
    return ", ".join(part for part in (names, sizes, score, seconds) if part)
