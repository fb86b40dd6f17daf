"""Blind recordings with laws of random form, made by the rod equations: what is found of them?

`python -m benchmarks.discovery.laws --seed 11 --count 12 --out laws` makes them, diagnoses each by
the command line and prints how many slots and forms are right, how often the intervals hold the
truth, and how many clean ropes and known effects were called a law. What is finished is kept.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from benchmarks.discovery import made, make
from benchmarks.discovery.concealed import PHYSICS
from benchmarks.discovery.concealment import Concealed
from benchmarks.discovery.run import diagnose, kept, read_json
from benchmarks.discovery.setting import Setting, World
from reference_simulators.collocation import NotConverged
from reference_simulators.rod_equations import Array

LAWS = ("bending_law",)
SCORES = (30.0, 60.0, 120.0)
Moment = Callable[[Array], Array]


def tabulated(moment: Moment, highest: float) -> Callable[[Array], tuple[Array, Array]]:
    """Return the curvature, and its derivative, of a moment; linear beyond `highest` [1/m]."""
    k = np.concatenate([[0.0], np.geomspace(1e-4 * highest, highest, 4000)])
    inverse = PchipInterpolator(moment(k), k)
    slope, top = inverse.derivative(), float(moment(k[-1:])[0])

    def bent(m: Array) -> tuple[Array, Array]:
        inside = np.minimum(m, top)
        rate = slope(inside)
        return inverse(inside) + rate * (m - inside), rate

    return bent


def bending(setting: Setting, rng: np.random.Generator) -> tuple[Concealed, dict[str, Any]]:
    """Draw a form: a power, a + b k², or tanh. The size takes the law away from the linear one."""
    rod, turn = setting.rod, setting.states[..., 10:]
    usual = float(np.quantile(np.linalg.norm(turn, axis=-1), 0.9)) / rod.bending
    kind = str(rng.choice(["power-", "power+", "cubic", "tanh"]))

    def truth(size: float) -> tuple[Moment, dict[str, float]]:
        if kind.startswith("power"):
            n = 1 / (1 + size) if kind == "power-" else 1 + size
            # Of finite slope at zero, far below all curvatures.
            return lambda k: rod.bending * k * ((k / usual) ** 2 + 1e-4) ** ((n - 1) / 2), {"n": n}
        if kind == "cubic":
            return lambda k: rod.bending * k * (1 + size * (k / usual) ** 2), {
                "b": rod.bending * size / usual**2
            }
        return (
            lambda k: (
                rod.bending * usual / size * (np.tanh(k * size / usual) + 1e-3 * k * size / usual)
            ),
            {"k0": usual / size},
        )

    def change(world: World, size: float) -> World:
        table = tabulated(truth(size)[0], 20 * usual)
        return replace(world, rod=replace(world.rod, bent=table))

    forms = {"power-": "(n-1)", "power+": "(n-1)", "cubic": "b > 0", "tanh": "tanh"}
    most = {"power-": 2.0, "power+": 1.5, "cubic": 30.0, "tanh": 3.0}[kind]
    concealed = Concealed("bending_law", "unknown", change, 0.2, most, kind, "1", follows=True)
    return concealed, {"form": forms[kind], "constants": lambda size: truth(size)[1]}


DRAWN = {"bending_law": bending}


def kinds(count: int) -> list[str]:
    """Return what the recordings hold: every other one a law, else a known effect or nothing."""
    known = [name for name in PHYSICS if name != "end_twist"]
    every = ((LAWS[k // 2 % len(LAWS)], known[5 * k % len(known)]) for k in range(count))
    return [(law, effect, law, "clean")[k % 4] for k, (law, effect) in enumerate(every)]


def recording(kind: str, seed: int, folder: Path, truth_file: Path) -> dict[str, Any]:
    """Make one recording; return its truth."""
    if truth_file.exists():
        return read_json(truth_file)
    for attempt in range(6):
        rng = np.random.default_rng([seed, attempt])
        told: dict[str, Any] = {}

        def drawn(setting: Setting, rng: np.random.Generator, told=told) -> Concealed:
            concealed, more = DRAWN[kind](setting, rng)
            told.update(more)
            return concealed

        if kind in DRAWN:
            make.CATALOGUE[kind] = drawn
        names = [] if kind == "clean" else [kind]
        try:
            found = make.make(
                names, [float(rng.choice(SCORES)) for _ in names], int(rng.integers(2**31)),
                calibration=bool(seed % 2),
            )  # fmt: skip
        except (make.Implausible, NotConverged, np.linalg.LinAlgError, RuntimeError):
            continue
        truth = made.write(folder, truth_file, folder.name, found, seed, "law")
        if told:
            size = found.sized[0].size
            truth |= {"form": told["form"], "constants": told["constants"](size), "size": size}
        truth |= {"kind": kind}
        truth_file.write_text(json.dumps(truth, indent=1) + "\n")
        return truth
    raise RuntimeError(f"{kind}: no recording could be made from seed {seed}")


def judged(truth: dict[str, Any], answer: dict[str, Any]) -> dict[str, Any]:
    """Return what is right of an answer; None where that is not asked."""
    kind, effects = truth["kind"], answer["effects"] if answer["verdict"] == "found" else []
    names = [e["name"] for e in effects]
    out: dict[str, Any] = {"kind": kind, "verdict": answer["verdict"], "names": names}
    out["false law"] = any(n in LAWS for n in names) if kind not in LAWS else None
    if kind not in LAWS:
        return out
    out["slot"] = bool(names) and names[0] == kind
    held = answer["heldout"]
    out["rms/noise"] = held["rms_after_m"] / held["noise_m"]
    law = next((e["law"] for e in effects if e["name"] == kind), None)
    if law is None:
        return out
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


def main() -> None:
    """Make, diagnose, judge, print."""
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--seed", type=int, default=11)
    arguments.add_argument("--count", type=int, default=12)
    arguments.add_argument("--out", type=Path, default=Path("laws"))
    options = arguments.parse_args()
    judgements = []
    for k, kind in enumerate(kinds(options.count)):
        name = f"{options.seed}-{k:03d}-{kind}"
        out = options.out
        truth = recording(kind, 1000 * options.seed + k, out / name, out / "truth" / f"{name}.json")
        run = out / "runs" / name
        result = kept(out / "results" / f"{name}.json", lambda f=out / name, r=run: diagnose(f, r))
        if result["answer"] is None:
            print(name, "failed:", result["error"], flush=True)
            continue
        judgements.append(judged(truth, result["answer"]))
        print(name, json.dumps(judgements[-1]), result["seconds"], flush=True)
    for what in ("slot", "form", "named", "false law"):
        asked = [j[what] for j in judgements if j.get(what) is not None]
        print(f"{what}: {sum(asked)} of {len(asked)}")
    within = [v[-1] for j in judgements for v in j.get("covered", {}).values()]
    print(f"intervals that hold the truth: {sum(within)} of {len(within)}")


if __name__ == "__main__":
    main()
