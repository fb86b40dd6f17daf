"""Coverage of the 95 % intervals, on simulated recordings whose truth is known.

    python -m benchmarks.accuracy.coverage [--recordings N] [--write docs/results.md] [--json FILE]

Each recording: a pinned rope of a rod four times finer than the fit's, 24 frames of a motion in
space, white noise on the points, and errors of camera, scale, gravity and ends drawn from the
priors that the fit assumes. Every other rope has its length fitted too.
"""

from __future__ import annotations

import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from scipy import stats

from benchmarks.document import parser, publish
from benchmarks.threads import use_threads
from ropefit.fitting.equilibrium import calibrated_fit
from ropefit.inference.bins import Data
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.inference.profile import profile_intervals
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS, Range
from ropefit.models.priors import Priors, calibration
from ropefit.rod.rod import uniform
from ropefit.rod.setup import Setup, bare

FRAMES, NODES = 24, 20
COARSE, FINE = 152, 608  # segments of the fit's rod and of the truth's
DENSITY, GRAVITY = 0.06, (0.0, 0.0, -9.81)
EYE = (0.4, -1.6, 0.3)
POINTS, MARKERS = 240, 21


@dataclass(frozen=True)
class Case:
    """One recording: its truth, its data, and what the fit is given."""

    truth: dict[str, float]
    data: Data
    ends: np.ndarray
    sd: float


def motion(rng: np.random.Generator) -> np.ndarray:
    """Return ends (FRAMES, 2, 3) [m]: one stays, the other lifts, sweeps and comes nearer."""
    t = np.linspace(0, 1, FRAMES)
    phase = rng.uniform(0, 2 * np.pi, 3)
    reach = rng.uniform(0.45, 0.7) + rng.uniform(0.1, 0.22) * np.sin(2 * np.pi * t + phase[0])
    angle = rng.uniform(0.2, 0.7) * np.sin(2 * np.pi * t + phase[1])
    lift = rng.uniform(0.05, 0.25) * np.sin(4 * np.pi * t + phase[2])
    ends = np.zeros((FRAMES, 2, 3))
    ends[:, 0] = np.stack([reach * np.cos(angle), reach * np.sin(angle), lift], axis=1)
    return ends


def setup_of(ends: np.ndarray, segments: int, bend: float, length: float) -> Setup:
    """Return a pinned rope in every frame, seen from EYE."""
    return bare(
        uniform(length=length, segments=segments, bend=bend, density=DENSITY),
        np.array(GRAVITY),
        ends,
        np.full((len(ends), 2, 4), np.nan),
        np.array(EYE),
    )


def draw(seed: int, markers: bool) -> Case:
    """Draw a recording of a rope of random stiffness and length."""
    rng = np.random.default_rng(seed)
    ends = motion(rng)
    bend = float(np.exp(rng.uniform(np.log(2e-4), np.log(4e-3))))
    length = float(rng.uniform(0.97, 1.03))
    sd = float(rng.uniform(0.0005, 0.002))
    setup = setup_of(ends, FINE, bend, length)
    forward = Equilibrium(setup, calibration(setup, Priors(), shared=False))
    point = forward.at(rng.normal(size=forward.size))
    if not point.solution.converged.all():
        raise ArithmeticError(f"recording {seed} cannot be simulated")
    x, count = point.seen, MARKERS if markers else POINTS
    share = np.sort(rng.uniform(0, 1, (FRAMES, count)), axis=1)
    if markers:
        share[:] = np.linspace(0, 1, MARKERS)
    at = share * FINE
    low = np.minimum(at.astype(int), FINE - 1)
    rest, rows = (at - low)[..., None], np.arange(FRAMES)[:, None]
    points = (1 - rest) * x[rows, low] + rest * x[rows, low + 1]
    points = points + rng.normal(0, sd, points.shape)
    if not markers:  # where preprocess believes the points to be
        share = np.clip(share + rng.normal(0, 0.003, share.shape), 0, 1)
    mask = np.ones(share.shape, bool)
    data = Data(points, share, mask, markers, np.array(EYE))
    return Case({"EI": bend, "length": length}, data, ends, sd)


def judge(number: int) -> dict[str, float] | None:
    """Return where the truth lies in the intervals: (truth - middle) over half widths, by name.

    None for a recording whose fit did not converge.
    """
    use_threads(1)
    markers, with_length = number % 4 >= 2, number % 2 == 1
    case = draw(number, markers)
    length = 1.0 if with_length else case.truth["length"]
    setup = setup_of(case.ends, COARSE, 1e-3, length)
    terms = [PARAMETERS["EI"].within(Range(1e-3, 1e-7, 10.0))]
    if with_length:
        terms.append(PARAMETERS["length"].within(Range(1.0, 0.8, 1.25)))
    noise = Noise(marker=case.sd if markers else 0.0)
    problem = FitProblem(case.data, noise, NODES - 1)
    first = fit(Equilibrium(setup, terms), problem, evaluations=15)
    full = Equilibrium(setup, [*terms, *calibration(setup, Priors(), shared=False)])
    loose = max(1.0, first.scale) if markers else 1.0
    found = calibrated_fit(full, first.point.u, problem, 60, loose)
    if not found.converged:
        return None
    out = {
        "scale": found.scale,
        "correlated": found.problem.noise.correlated,
        "seed": float(number),
    }
    for name, told in profile_intervals(found).of.items():
        if told.interval is None:
            continue
        low, high = np.log(told.interval)
        off = (np.log(case.truth[name]) - 0.5 * (low + high)) / (0.5 * (high - low))
        out[name], out[f"{name}_width"] = float(off), float(0.5 * (high - low))
    return out


def measure(recordings: int, workers: int = 2) -> dict[str, object]:
    """Return shares of intervals that contain the truth, with their own 95 % uncertainty."""
    begun = time.perf_counter()
    with ProcessPoolExecutor(workers) as pool:
        rows = list(pool.map(judge, range(recordings), chunksize=4))
    fits = [row for row in rows if row is not None]
    out: dict[str, object] = {
        "recordings": recordings,
        "converged": len(fits),
        "seconds": time.perf_counter() - begun,
        "scale": float(np.median([row["scale"] for row in fits])),
    }
    for name in ("EI", "length"):
        for kind in ("all", "clouds", "markers"):
            mine = [
                row
                for row in fits
                if name in row and (kind == "all" or (row["seed"] % 4 >= 2) == (kind == "markers"))
            ]
            off = np.array([row[name] for row in mine])
            inside, total = int((np.abs(off) <= 1).sum()), len(off)
            if total == 0:
                continue
            between = stats.binomtest(inside, total).proportion_ci(0.95)
            out[f"{name} {kind}"] = {
                "intervals": total,
                "share": inside / total,
                "low": float(between.low),
                "high": float(between.high),
                "half_width": float(np.median([row[f"{name}_width"] for row in mine])),
                "spread": float(np.std(off)),
                "mean": float(np.mean(off)),
            }
    return out


def main() -> None:
    """Print the table; write it where asked."""
    arguments = parser(__doc__)
    arguments.add_argument("--recordings", type=int, default=400)
    options = arguments.parse_args()
    data = measure(options.recordings)
    lines = [
        f"{data['recordings']} simulated recordings, {data['converged']} fits converged; written "
        "by `python -m benchmarks.accuracy.coverage`.",
        "A pinned rope of 1 m, 24 frames of a motion in space, points with 0.5 to 2 mm of noise,",
        f"calibration errors drawn from the default priors, truth on {FINE} segments, the fit on "
        f"{COARSE}.",
        "",
        "| parameter | data | intervals | contain the truth | its 95 % interval "
        "| median half width |",
        "|---|---|---|---|---|---|",
    ]
    for key, row in data.items():
        if isinstance(row, dict):
            name, kind = key.split()
            lines.append(
                f"| {name} | {kind} | {row['intervals']} | {row['share']:.1%} "
                f"| {row['low']:.1%} to {row['high']:.1%} | {row['half_width']:.2%} |"
            )
    publish(options, "coverage", "\n".join(lines) + "\n", data)


if __name__ == "__main__":
    main()
