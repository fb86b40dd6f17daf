"""Blind recordings with laws of random form, of simulators that are not ropefit's: what is found?

python -m benchmarks.discovery.laws [--seed S] [--count N] [--shard I/N] [--out DIR] [--score-only]
[--only PATTERN] [--write docs/laws.md]

Of four recordings two have a law, one a known effect, one nothing. All are of the rod equations at
rest, but those of drag: of MuJoCo's rope, shaken; how visible its exponent is, is known after the
recording is made, and recordings that hardly show it are listed by themselves. Each is made,
diagnosed by the command line and judged; what is finished is kept in DIR.
"""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery import made, make
from benchmarks.discovery.concealed import PHYSICS
from benchmarks.discovery.concealment import Concealed
from benchmarks.discovery.law_causes import DRAWN, STRETCH, Drawn
from benchmarks.discovery.run import diagnose, kept, read_json
from benchmarks.discovery.score import VISIBLE
from benchmarks.discovery.setting import Setting
from benchmarks.document import write_section
from reference_simulators.collocation import NotConverged

IN_MOTION = "drag_law"
LAWS = (*DRAWN, IN_MOTION)
SCORES = {"axial_law": (12.0, 20.0, 40.0)}  # with any linear stretch; larger ones are implausible
USUAL_SCORES = (30.0, 60.0, 120.0)
LINEAR = {"axial_law": "axial_extensibility"}  # an effect that a law corrects: named beside it


def kinds(count: int) -> list[str]:
    """Return what the recordings hold: every other one a law, else a known effect or nothing."""
    known = [name for name in PHYSICS if name != "end_twist"]
    every = ((LAWS[k // 2 % len(LAWS)], known[5 * k % len(known)]) for k in range(count))
    return [(law, effect, law, "clean")[k % 4] for k, (law, effect) in enumerate(every)]


def recording(kind: str, seed: int, folder: Path, truth_file: Path) -> dict[str, Any]:
    """Make one recording; return its truth."""
    if truth_file.exists():
        return read_json(truth_file)
    if kind == IN_MOTION:
        from benchmarks.discovery import motions

        _, concealed = motions.make(folder, seed, "laws")
        assert concealed is not None
        truth = {"form": "^n", "constants": {"n": concealed.size}}
        return _kept(truth_file, truth | {"kind": kind})
    for attempt in range(6):
        rng = np.random.default_rng([seed, attempt])
        told: list[Drawn] = []

        def drawn(setting: Setting, rng: np.random.Generator, told=told) -> Concealed:
            told.append(DRAWN[kind](setting, rng))
            return told[-1].concealed

        if kind in DRAWN:
            make.CATALOGUE[kind] = drawn
        names = [] if kind == "clean" else [kind]
        stretch = float(rng.uniform(*STRETCH)) if kind == "axial_law" else 0.0
        try:
            found = make.make(
                names, [float(rng.choice(SCORES.get(kind, USUAL_SCORES))) for _ in names],
                int(rng.integers(2**31)), calibration=bool(seed % 2), stretch=stretch,
            )  # fmt: skip
        except (make.Implausible, NotConverged, np.linalg.LinAlgError, RuntimeError):
            continue
        truth = made.write(folder, truth_file, folder.name, found, seed, "law")
        if told:
            size = found.sized[0].size
            law = told[-1]
            truth |= {"form": law.form, "constants": law.constants(size), "size": size}
        return _kept(truth_file, truth | {"kind": kind})
    raise RuntimeError(f"{kind}: no recording could be made from seed {seed}")


def _diagnosed_in_motion(folder: Path, run: Path) -> dict[str, Any]:
    from benchmarks.discovery import motions  # needs MuJoCo

    return motions.diagnosed(folder, run)


def _visible(seed: int, folder: Path, run: Path, truth_file: Path) -> bool:
    """Return whether a recording in motion shows its law."""
    from benchmarks.discovery import motions

    stored = truth_file.with_suffix(".score.json")
    score = motions.visibility(motions.staged(seed, "laws"), folder, run, stored)
    return score is not None and score >= VISIBLE


def _kept(file: Path, truth: dict[str, Any]) -> dict[str, Any]:
    """Write a truth; return it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(json.dumps(truth, indent=1) + "\n")
    return truth


def judged(truth: dict[str, Any], answer: dict[str, Any]) -> dict[str, Any]:
    """Return what is right of an answer; None where that is not asked."""
    kind, effects = truth["kind"], answer["effects"] if answer["verdict"] == "found" else []
    names = [e["name"] for e in effects]
    out: dict[str, Any] = {"kind": kind, "verdict": answer["verdict"], "names": names}
    out["false law"] = any(n in LAWS for n in names) if kind not in LAWS else None
    if kind not in LAWS:
        return out
    out["slot"] = kind in names and all(n in (kind, LINEAR.get(kind)) for n in names[:2])
    held = answer["heldout"]
    out["rms"] = held["rms_after_m"] / held["noise_m"] <= 1.10
    if not out["slot"] or not truth["form"]:
        return out
    law = next(e["law"] for e in effects if e["name"] == kind)
    out["forms"], out["true form"] = law["forms"], truth["form"]
    out["named"] = bool(law["form"])
    out["form"] = any(truth["form"] in f for f in law["forms"])
    if law["forms"] and truth["form"] in law["forms"][0]:
        within = {}
        for name, value in truth["constants"].items():
            if name in law["parameters"]:
                low, high = law["parameters"][name]["ci95"]
                within[name] = [value, low, high, bool(low <= value <= high)]
        out["covered"] = within
    return out


def _shares(judgements: list[dict[str, Any]]) -> dict[str, str]:
    """Return how many of those that are asked are right, by what."""
    out = {}
    for what in ("slot", "form", "named", "rms", "false law"):
        asked = [j[what] for j in judgements if j.get(what) is not None]
        out[what] = f"{sum(asked)} of {len(asked)}" if asked else "-"
    within = [v[-1] for j in judgements for v in j.get("covered", {}).values()]
    out["covered"] = f"{sum(within)} of {len(within)}" if within else "-"
    return out


def table(judgements: list[dict[str, Any]], asked: int, command: str) -> str:
    """Return the table of docs/laws.md: of so many recordings that were asked for."""
    lines = [
        f"{len(judgements)} of {asked} recordings by the rod equations, scores 30 to 120 (of",
        "`axial_law` 12 to 40, with any linear stretch), and of drag by MuJoCo's rope, shaken; by",
        f"`python -m benchmarks.discovery.laws {command}`. *Form*: the true one"
        " is among those that",
        "remain; *named*: it alone remains; *constants*: exponents and lengths of the best form,"
        " where it is the true one, in their",
        "95 % intervals; *rms*: of held-out points, at most 1.10 times the noise.",
        "",
        "| concealed | recordings | law found | form | named | constants | rms | called a law |",
        "|---|---|---|---|---|---|---|---|",
    ]
    visible = [j for j in judgements if j["visible"]]
    groups = [(kind, [kind]) for kind in LAWS]
    known = sorted({j["kind"] for j in judgements} - {*LAWS, "clean"})
    groups += [("all laws", list(LAWS)), ("a known effect", known), ("nothing", ["clean"])]
    for name, members in groups:
        own = [j for j in visible if j["kind"] in members]
        if not own:
            continue
        s = _shares(own)
        cells = (s["slot"], s["form"], s["named"], s["covered"], s["rms"], s["false law"])
        lines.append(f"| {name} | {len(own)} | {' | '.join(cells)} |")
    wrong = [_told(j) for j in visible if j.get("slot") is False or j.get("false law")]
    hidden = [_told(j) for j in judgements if not j["visible"]]
    forms = [
        f"{j['case']} ({j['true form']}): {', '.join(j['forms']) or 'none'}"
        for j in visible
        if j.get("form") is False
    ]
    lines += ["", f"Not right: {'; '.join(wrong) or 'none'}.", ""]
    lines += [f"True form not among those reported: {'; '.join(forms) or 'none'}."]
    if hidden:
        lines += ["", f"Score below {VISIBLE:.0f}, not judged: {'; '.join(hidden)}."]
    return "\n".join(lines)


def _told(judgement: dict[str, Any]) -> str:
    """Return a case and what was answered."""
    return f"{judgement['case']}: {', '.join(judgement['names']) or judgement['verdict']}"


def main() -> None:
    """Make, diagnose, judge, print."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seed", type=int, default=11)
    arguments.add_argument("--count", type=int, default=60)
    arguments.add_argument("--shard", default="1/1", help="I/N: every N-th case from the I-th")
    arguments.add_argument("--out", type=Path, default=Path("laws"))
    arguments.add_argument("--score-only", action="store_true", help="only what is finished")
    arguments.add_argument("--write", type=Path, help="document to write the table into")
    arguments.add_argument("--only", default="", help="regular expression of the names of cases")
    options = arguments.parse_args()
    part, of = (int(n) for n in options.shard.split("/"))
    every = [
        (k, kind, f"{options.seed}-{k:03d}-{kind}") for k, kind in enumerate(kinds(options.count))
    ]
    every = [one for one in every if re.search(options.only, one[2])]
    judgements, out = [], options.out
    for k, kind, name in every:
        file = out / "results" / f"{name}.json"
        if k % of != part - 1 or (options.score_only and not file.exists()):
            continue
        seed, truth_file = 1000 * options.seed + k, out / "truth" / f"{name}.json"
        truth = recording(kind, seed, out / name, truth_file)
        run = out / "runs" / name
        how = _diagnosed_in_motion if kind == IN_MOTION else diagnose
        result = kept(file, lambda f=out / name, r=run, how=how: how(f, r))
        if result["answer"] is None:
            print(name, "failed:", result["error"], flush=True)
            continue
        visible = kind != IN_MOTION or _visible(seed, out / name, run, truth_file)
        found = judged(truth, result["answer"])
        judgements.append(found | {"case": name, "visible": visible})
        print(name, json.dumps(judgements[-1]), result["seconds"], flush=True)
    command = f"--seed {options.seed} --count {options.count}"
    section = "discovery-laws"
    if options.only:
        command, section = f"{command} --only {options.only}", f"{section}-{options.only}"
    text = table(judgements, len(every), command)
    print(text)
    if options.write:
        write_section(options.write, section, text)


if __name__ == "__main__":
    main()
