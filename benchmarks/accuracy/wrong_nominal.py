"""What `diagnose --nominal` says of a weight on a rope whose nominal model is wrong.

    python -m benchmarks.accuracy.wrong_nominal [--seeds 350:362] [--keep DIR]
                                                [--write docs/results.md] [--json FILE]

A cable is held at its base, at 23 angles, and seen by markers off its axis; then again with a
weight. The simulator is not ropefit's. The cable has what its nominal model (`--free
EI,rest_curve`) lacks: sharp bends, friction or a law that softens inside it, a softer stretch, a
fitting at its tip, a base mounted askew. Both are diagnosed by the command line, the second with
the first as its nominal run. Pairs in the folder of --keep are not tried again.
"""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.discovery.run import kept, stages
from benchmarks.document import parser, publish
from reference_simulators.planar_cable import GRAVITY, Cable, poses

PIECES, FRAMES, FREE = 40, 23, "EI,rest_curve"
TURNS = np.radians(np.linspace(-165, 165, FRAMES))  # of the base, from hanging
NOISE, OFF_AXIS, ASKEW = 6e-4, 4e-3, np.radians(2.0)  # m, m, rad
NEAR_PLACE = 0.005  # of the length: least half width of a place that is told
NAME, SILENT = "point_mass", ("none", "unknown")
# What each cable has: sharp bends, and a base that is not turned as told.
ALWAYS = frozenset({"kink", "intrinsic_curvature", "clamped_end", "gravity_misalignment"})


@dataclass(frozen=True)
class Pair:
    """A cable, the weight that is added (place as a share, kg), the angles of its base as they are
    and as told, and its markers' places (M,) and offsets (M,) [m]."""

    cable: Cable
    weight: tuple[float, float]
    bases: np.ndarray
    told: np.ndarray
    places: np.ndarray
    offsets: np.ndarray


def drawn(rng: np.random.Generator) -> Pair:
    """Draw a cable with what its nominal model does not know."""
    length = rng.uniform(0.4, 0.9)
    mass = length * rng.uniform(0.3, 1.2)
    bend = np.full(PIECES, rng.uniform(0.05, 0.2) * mass * GRAVITY * length**2)
    rest = np.full(PIECES, rng.normal(0, 0.8) / PIECES)
    for _ in range(rng.integers(1, 4)):
        rest[rng.integers(1, PIECES - 1)] += rng.normal(0, 0.2)
    cable = Cable(length, mass, bend, rest)
    if rng.random() < 0.6:
        cable = replace(cable, slip=rng.uniform(0.3, 1.5) / length, rub=rng.uniform(0.1, 0.6))
    if rng.random() < 0.4:
        cable = replace(cable, soft=rng.uniform(5, 20) / length)
    if rng.random() < 0.5:
        low, high = sorted(rng.uniform(0, PIECES, 2).astype(int))
        bend[low:high] *= np.exp(rng.normal(0, 0.3))
    if rng.random() < 0.5:
        cable = replace(cable, weights=((1.0, rng.uniform(0.02, 0.08) * mass),))
    place = 1.0 if rng.random() < 0.5 else rng.uniform(0.75, 1.0)
    near_first = np.argsort(np.abs(TURNS), kind="stable")
    told = -np.pi / 2 + TURNS[rng.permutation(FRAMES) if rng.random() < 0.3 else near_first]
    places = np.linspace(0, 1, int(rng.choice([3, 3, 5, 9])))
    offsets = np.where(places > 0, rng.normal(0, OFF_AXIS, len(places)), 0.0)
    added = rng.uniform(0.15, 0.5) * mass
    return Pair(cable, (place, added), told + rng.normal(0, ASKEW), told, places, offsets)


def true_effects(pair: Pair) -> frozenset[str]:
    """Return the names of the effects that a cable has without its added weight."""
    cable, out = pair.cable, set(ALWAYS)
    if np.isfinite(cable.slip):
        out |= {"bending_hysteresis", "plastic_set"}
    if np.isfinite(cable.soft):
        out.add("bending_law")
    if np.ptp(cable.bend) > 0:
        out |= {"soft_section", "stiff_section"}
    if cable.weights:
        out |= {"point_mass", "mass_section"}
    return frozenset(out)


def recorded(pair: Pair, weights: tuple[tuple[float, float], ...], folder: Path, seed: int) -> Path:
    """Write a recording of the cable with some weights besides its own."""
    rng, cable = np.random.default_rng(seed), pair.cable
    cable = replace(cable, weights=(*cable.weights, *weights))
    x = poses(cable, pair.bases, pair.places)
    along = np.gradient(x, axis=1)
    along /= np.linalg.norm(along, axis=2, keepdims=True)
    x = x + pair.offsets[:, None] * np.stack([-along[..., 1], along[..., 0]], axis=-1)
    positions = np.insert(x, 1, 0.0, axis=2) + rng.normal(0, NOISE, (*x.shape[:2], 3))
    folder.mkdir()
    np.savez(folder / "markers.npz", positions=positions, time=np.arange(FRAMES, dtype=float))
    half = 0.5 * (np.pi / 2 - pair.told)
    rows = [
        f"{t},{t},0,0,0,0,{np.cos(h):.9f},0,{np.sin(h):.9f},0" for t, h in enumerate(half.tolist())
    ]
    (folder / "ends.csv").write_text("\n".join(["frame,time,end,x,y,z,qw,qx,qy,qz", *rows]) + "\n")
    (folder / "recording.toml").write_text(
        f'format = "ropefit-recording/1"\nname = "{folder.name}-{seed}"\n'
        f"gravity = [0.0, 0.0, {-GRAVITY}]\n[rope]\nlength = {cable.length}\ndiameter = 0.02\n"
        f'mass = {cable.mass}\n[markers]\nfile = "markers.npz"\n'
        f'arc_length = {(pair.places * cable.length).tolist()}\n[ends]\nfile = "ends.csv"\n'
    )
    return folder


def tried(seed: int) -> dict[str, Any]:
    """Return what a pair's diagnosis says, the truth, and the processor time [s] of all stages of
    that of the two recordings which took longer."""
    pair = drawn(np.random.default_rng(seed))
    place, mass = pair.weight
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        nominal, run = folder / "run-without", folder / "run-with"
        fitted = stages(*_until_fitted(recorded(pair, (), folder / "without", 2 * seed), nominal))
        alone = stages(("diagnose", "--run", nominal))
        found = stages(
            *_until_fitted(recorded(pair, (pair.weight,), folder / "with", 2 * seed + 1), run),
            ("diagnose", "--run", run, "--nominal", nominal),
        )
    longest = max(found["processor"], fitted["processor"] + alone["processor"])
    return {
        "seed": seed, "longest": longest, "mass": mass, "place_m": place * pair.cable.length,
        "length_m": pair.cable.length, "rms_nominal_m": fitted["answer"]["rms_fit_m"],
        "alone": alone["answer"], "true_effects": sorted(true_effects(pair)), **found,
    }  # fmt: skip


def _until_fitted(recording: Path, run: Path) -> list[tuple[str | Path, ...]]:
    """Return the commands that prepare and fit a recording."""
    return [
        ("preprocess", recording, "--run", run),
        ("identify", "--run", run, "--free", FREE),
    ]


def judged(row: dict[str, Any]) -> dict[str, Any]:
    """Return whether the weight is named first, is in the reported set, something else is named
    instead, or nothing; whether the intervals of its mass and place hold the truth."""
    answer = row["answer"]
    effects = answer["effects"] if answer else []
    every = [{e["name"], *e["equivalent_to"]} for e in effects]
    out: dict[str, Any] = {
        "first": any(e["name"] == NAME for e in effects),
        "in the set": any(NAME in names for names in every),
        "silent": bool(answer) and answer["verdict"] in SILENT,
    }
    own = next((e for e in effects if e["name"] == NAME), None)
    if own is not None:
        low, high = own["parameters"]["mass"]["ci95"]
        near, far = own["arc_length_m"]
        margin = NEAR_PLACE * row["length_m"]
        out["mass holds"] = low <= row["mass"] <= high
        out["place holds"] = near - margin <= row["place_m"] <= far + margin
        out["half"] = 0.5 * (high - low) / row["mass"]
    return out


def named_falsely(row: dict[str, Any]) -> list[str]:
    """Return the effects that the diagnosis of the nominal recording alone names, where the cable
    has neither them nor any that ties with them."""
    effects = row["alone"]["effects"] if row["alone"] else []
    has = set(row["true_effects"])
    return [e["name"] for e in effects if not has & {e["name"], *e["equivalent_to"]}]


def table(rows: list[dict[str, Any]], seeds: str) -> str:
    """Return the table: what is named, and whether intervals hold the truth."""
    every = [judged(row) for row in rows]
    named = [one for one in every if one["first"]]
    wrong = [
        str(row["seed"])
        for row, one in zip(rows, every, strict=True)
        if not (one["in the set"] or one["silent"])
    ]
    tight = [
        str(row["seed"])
        for row, one in zip(rows, every, strict=True)
        if one["first"] and not (one["mass holds"] and one["place holds"])
    ]
    alone = [f"{row['seed']} ({', '.join(names)})" for row in rows if (names := named_falsely(row))]
    median = 1e3 * np.median([row["rms_nominal_m"] for row in rows])
    half = f"{100 * np.median([one['half'] for one in named]):.0f} %" if named else "-"
    longest = max(row["longest"] for row in rows)
    lines = [
        "Cables that their nominal model does not describe (sharp bends, friction, a softening",
        "law, a fitting at the tip, a base askew), at 23 angles without and with a weight;",
        f"{len(rows)} pairs whose nominal models leave {median:.1f} mm (median; noise 1 mm);",
        f"written by `python -m benchmarks.accuracy.wrong_nominal --seeds {seeds}`.",
        "",
        "| the weight, by `diagnose --nominal` | pairs |",
        "|---|---|",
        f"| named, or in the reported set | {sum(one['in the set'] for one in every)} |",
        f"| no effect named (`none`, `unknown`) | {sum(one['silent'] for one in every)} |",
        f"| something else named, without the weight in the set | {len(wrong)} |",
        f"| mass inside its 95 % interval | {_of(named, 'mass holds')} |",
        f"| place inside its 95 % interval | {_of(named, 'place holds')} |",
        f"| nominal recording alone: an effect named that the cable lacks | {len(alone)} |",
        f"| longest processor time of a recording, all stages [s] | {longest:.1f} |",
        "",
        f"Half an interval of the mass: {half} of the mass (median). Named wrongly:",
        f"{', '.join(wrong) or 'none'}; alone: {', '.join(alone) or 'none'}. Outside an interval:",
        f"{', '.join(tight) or 'none'}.",
    ]
    return "\n".join(lines) + "\n"


def _of(named: list[dict[str, Any]], key: str) -> str:
    return f"{sum(one[key] for one in named)} of {len(named)}"


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--seeds", default="350:362", help="first:last+1")
    arguments.add_argument("--keep", type=Path, default=None, help="folder of what is done")
    options = arguments.parse_args()
    rows = []
    for seed in range(*map(int, options.seeds.split(":"))):
        done = options.keep and options.keep / f"{seed}.json"
        rows.append(kept(done, lambda s=seed: tried(s)) if done else tried(seed))
        print(f"{seed}: {judged(rows[-1])}", flush=True)
    publish(options, "wrong-nominal", table(rows, options.seeds), {"pairs": rows})


if __name__ == "__main__":
    main()
