"""Coverage of a weight's size and place on a rope whose nominal model is wrong.

    python -m benchmarks.accuracy.wrong_nominal [--seeds 241:253] [--keep DIR]
                                                [--write docs/results.md] [--json FILE]

A cable is held at its base, at 23 angles, and seen by markers off its axis; then again with a
weight. The simulator is not ropefit's. The cable has what its nominal model (`--free
EI,rest_curve`) lacks: sharp bends, friction or a law that softens inside it, a softer stretch, a
fitting at its tip, a base mounted askew. The weight is fitted as `diagnose --nominal` does once it
has named it. Pairs in the folder of --keep are not tried again.
"""

from __future__ import annotations

import json
import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import ropefit
from benchmarks.discovery.run import read_json
from benchmarks.document import parser, publish
from reference_simulators.planar_cable import GRAVITY, Cable, poses
from ropefit.adapters.priors import noise_of
from ropefit.adapters.rope_setup import STATIONS, base_setup, data_in_space, segments_of
from ropefit.artifacts import Model, Observations
from ropefit.diagnosis.candidate import Candidate
from ropefit.diagnosis.candidates import fit_candidates
from ropefit.diagnosis.hypotheses import NO_PLACE, Hypothesis
from ropefit.diagnosis.noise_measurement import on_edge
from ropefit.diagnosis.wander import with_what_is_missed_alike
from ropefit.effects.point_mass import PointMass
from ropefit.errors import RopefitError
from ropefit.fitting.nominal import (
    nominal_at_rest,
    nominal_terms,
    set_up_errors,
    with_what_is_missed,
)
from ropefit.inference.least_squares import fit
from ropefit.inference.problem import FitProblem

PIECES, FRAMES, FREE = 40, 23, ["EI", "rest_curve"]
TURNS = np.radians(np.linspace(-165, 165, FRAMES))  # of the base, from hanging
NOISE, OFF_AXIS, ASKEW = 6e-4, 4e-3, np.radians(2.0)  # m, m, rad
NEAR_PLACE = 0.005  # of the length: least half width of a place that is told


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


def weighed(o: Observations, source: Model) -> Candidate | None:
    """Return the weight as fitted to a recording of a rope that is known from another."""
    data, setup = data_in_space(o), base_setup(o, segments_of(o))
    noise = with_what_is_missed(noise_of(o, data), source, o)
    terms, setup = nominal_terms(o, source, setup, prior=True, misfit=noise.misfit)
    problem = FitProblem(data, noise, STATIONS)
    terms += set_up_errors(setup, o, None)
    nominal = nominal_at_rest(setup, terms, problem)
    firm = np.flatnonzero(~on_edge(nominal))  # others are excluded
    setup, problem = setup.frames(firm), problem.frames(firm)
    nominal = nominal_at_rest(setup, terms, problem)
    mass = float((setup.properties.density * setup.properties.length).sum())
    point, length = Hypothesis(PointMass(), NO_PLACE), float(setup.properties.length.sum())
    starts = [
        [(point, np.array([share * mass, place * length]))]
        for place in (0.95, 0.75)
        for share in (0.2, 0.45)
    ]
    found = fit_candidates(nominal, [], starts, [], 0.0)
    if not found:
        return None
    best = found[0]
    problem = problem.under(with_what_is_missed_alike(problem.noise, best.fit, []))
    again = fit(best.fit.forward, problem, best.fit.point.u, 10, tolerance=1e-5)
    return replace(best, fit=again)


def tried(seed: int) -> dict[str, float]:
    """Return truth, estimate and half width of the interval of mass [kg] and place [share]."""
    pair = drawn(np.random.default_rng(seed))
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        before = ropefit.preprocess(recorded(pair, (), folder / "without", 2 * seed))
        after = ropefit.preprocess(recorded(pair, (pair.weight,), folder / "with", 2 * seed + 1))
    source = ropefit.fit(before, free=FREE)
    found = weighed(after, source)
    if found is None:
        raise RopefitError(f"{seed}: no weight could be fitted")
    (mass, place), half = found.values(), found.fit.quantile * found.sd()
    length = pair.cable.length
    return {
        "seed": seed, "rms_nominal_m": source.nominal.rms_fit,
        "mass": pair.weight[1], "mass_found": float(mass), "mass_half": float(half[0]),
        "place": pair.weight[0], "place_found": float(place / length),
        "place_half": max(float(half[1]) / length, NEAR_PLACE),
    }  # fmt: skip


def table(rows: list[dict[str, float]], seeds: str) -> str:
    """Return the table: how often intervals hold the truth, and how wide they are."""
    lines = [
        "Cables that their nominal model does not describe (sharp bends, friction, a softening",
        "law, a fitting at the tip, a base askew), held at 23 angles without and with a weight;",
        f"{len(rows)} pairs whose nominal models leave",
        f"{1e3 * np.median([r['rms_nominal_m'] for r in rows]):.1f} mm (median; noise 1 mm);",
        f"written by `python -m benchmarks.accuracy.wrong_nominal --seeds {seeds}`.",
        "",
        "| of the weight | intervals that hold the truth | rms error, in sd | median half width |",
        "|---|---|---|---|",
    ]
    for key, of in (("mass", "of the mass"), ("place", "of the length")):
        error = np.array([r[f"{key}_found"] - r[key] for r in rows])
        half = np.array([r[f"{key}_half"] for r in rows])
        share = half / np.array([r["mass"] for r in rows]) if key == "mass" else half
        inside = int((np.abs(error) <= half).sum())
        rms = np.sqrt((np.square(1.96 * error / half)).mean())
        lines.append(
            f"| {key} | {inside} of {len(rows)} | {rms:.2f} | {100 * np.median(share):.0f} % {of} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    arguments = parser(__doc__)
    arguments.add_argument("--seeds", default="241:253", help="first:last+1")
    arguments.add_argument("--keep", type=Path, default=None, help="folder of what is done")
    options = arguments.parse_args()
    rows = []
    for seed in range(*map(int, options.seeds.split(":"))):
        done = options.keep and options.keep / f"{seed}.json"
        rows.append(read_json(done) if done and done.exists() else tried(seed))
        if done:
            options.keep.mkdir(parents=True, exist_ok=True)
            done.write_text(json.dumps(rows[-1]))
        print(rows[-1], flush=True)
    publish(options, "wrong-nominal", table(rows, options.seeds), {"pairs": rows})


if __name__ == "__main__":
    main()
