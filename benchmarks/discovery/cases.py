"""The list of cases, from one seed."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from benchmarks.discovery import made, make
from benchmarks.discovery.concealed import (
    HISTORY_DEPENDENT,
    IN_MOTION,
    NEEDS_CLAMPS,
    NEEDS_PINS,
    PHYSICS,
)
from benchmarks.discovery.concealed_errors import MEASUREMENT, UNKNOWN
from reference_simulators.collocation import NotConverged

SCORES = (3.0, 6.0, 6.0, 12.0, 12.0, 30.0, 30.0, 100.0)
STRONG = 300.0
SEEN = (12.0, 30.0, 100.0)  # of history-dependent ropes
MOVING = (30.0, 100.0)  # of ropes that are filmed in motion
# Effects that MuJoCo's rope can have as well: about half of their recordings are made by it.
IN_MUJOCO = (
    "point_mass", "mass_section", "stiff_section", "soft_section", "distributed_load", "tether",
    "support_plane", "obstacle",
)  # fmt: skip
COARSE_NODES = (8, 10, 12, 14)
ATTEMPTS = 4
MANY_CLEAN = 300  # of the blind set: three false alarms are 1 %


@dataclass(frozen=True)
class Case:
    """One recording to make and to diagnose."""

    name: str
    group: str  # clean, single, pair, decoy, coarse, unknown
    seed: int
    effects: tuple[str, ...] = ()
    score: float = 0.0
    clamped: bool = False
    calibration: bool = False
    simulator: str = "elastica"  # or mujoco
    filmed: bool = False  # in motion
    nominal: bool = False  # and recorded at rest as well, for `--nominal`
    dragged: bool = False  # over a rough table
    preprocess: tuple[str, ...] = field(default=())  # further options of the command


def listed(size: str, seed: int = 5) -> list[Case]:
    """Return the cases of a set: small, standard, blind (standard with 300 clean ones), full, or
    strong: effects far more visible than needed, whose shapes no linear theory describes."""
    many, size = size == "blind", "standard" if size == "blind" else size
    rng = np.random.default_rng(seed)
    cases: list[Case] = []

    def add(group: str, index: int, effects: tuple[str, ...] = (), score: float = 0.0, **more):
        label = "-".join([group, *(e.replace("_", "") for e in effects)])
        clamped, calibration = index % 2 == 1, index // 2 % 2 == 1
        shared = all(effect in IN_MUJOCO for effect in effects)
        often = 2 if group == "single" else 10  # MuJoCo takes a minute or two
        own = group in ("clean", "single") and shared and (index // 4) % often == 1
        own = own and not (clamped and set(effects) & {"support_plane", "obstacle"})
        own = own and not (clamped and calibration)  # its far clamp never turns
        only = "filmed" in more or "dragged" in more
        number = int(rng.integers(2**31))
        case = Case(f"{label}-{index:03d}", group, number, effects, score, clamped, calibration,
                    "mujoco" if own or only else "elastica", **more)  # fmt: skip
        cases.append(case)

    counts = {"small": (2, 1, 1, 1, 1), "standard": (20, 10, 2, 4, 2), "full": (300, 20, 2, 10, 4),
              "strong": (0, 16, 0, 0, 0)}  # fmt: skip
    clean, pairs, decoys, coarse, unknown = counts[size]
    for i in range(clean):
        add("clean", 3 * i if size == "small" else i)
    for k, name in enumerate(PHYSICS):
        if size == "small":
            if k % 3 == 0:
                add("single", 4 * (k % 2), (name,), 30.0)
        elif size == "strong":
            add("single", 4 * (k % 2) + k // 2 % 4, (name,), STRONG)
        elif size == "standard":
            for i, score in enumerate((6.0, 12.0, 30.0, 100.0)):
                add("single", i + 4 * (k % 2), (name,), score)
        else:
            for i, score in enumerate(SCORES):
                add("single", i, (name,), score)
    names = [*PHYSICS, "scale_error", "end_offset"]
    for i in range(pairs):
        while True:
            two = tuple(str(n) for n in rng.choice(names, 2, replace=False))
            clamps = NEEDS_CLAMPS & set(two)
            if not (clamps and NEEDS_PINS & set(two)):
                break
        add("pair", i, two, 100.0 if size == "strong" else 30.0)
    for name in MEASUREMENT:
        if size == "small" and name not in ("gravity_misalignment", "scale_error"):
            continue
        for i in range(decoys):
            add("decoy", i, (name,))
    for i in range(coarse):
        nodes = COARSE_NODES[i % len(COARSE_NODES)]
        add("coarse", i, preprocess=("--nodes", str(nodes)))
    for name in UNKNOWN:
        if size == "small" and name != "repulsion":
            continue
        for i in range(unknown):
            add("unknown", i, (name,), (30.0, 100.0)[i % 2])
    if size == "strong":
        return cases
    for k, name in enumerate(HISTORY_DEPENDENT):
        for i, score in enumerate({"small": (30.0,), "standard": SEEN}.get(size, SCORES)):
            add("single", i + k, (name,), score)
    for k, name in enumerate(IN_MOTION):
        for i, score in enumerate({"small": (100.0,), "standard": MOVING}.get(size, 2 * MOVING)):
            known = (i + k) % 2 == 0
            add("single", i + 2 * k, (name,), score, filmed=True, nominal=known)
    for i in range({"small": 0, "standard": 2}.get(size, 4)):
        add("pair", 2 * i, ("support_plane", "contact_friction"), dragged=True)
    for i in range(clean, MANY_CLEAN if many else clean):
        add("clean", i)
    return cases


def generate(case: Case, recordings: Path, truths: Path) -> str | None:
    """Make one recording, unless it is there; says why if that is not possible.

    A rope whose effect cannot be as visible as asked is drawn again, up to four times.
    """
    truth = truths / f"{case.name}.json"
    if truth.exists() and (recordings / case.name / "recording.toml").exists():
        return None
    why = ""
    for attempt in range(ATTEMPTS):
        seed = case.seed + attempt
        try:
            if case.filmed:
                _film(case, seed, recordings, truths)
                return None
            found = _dragged(case, seed) if case.dragged else _posed(case, seed)
        except (make.Implausible, NotConverged, np.linalg.LinAlgError, RuntimeError) as error:
            why = f"{type(error).__name__}: {error}"
            continue
        made.write(recordings / case.name, truth, case.name, found, seed, case.group)
        return None
    return why


def at_rest(case: Case) -> str:
    """Return the name of the recording of a filmed rope at rest."""
    return f"{case.name}-still"


def _posed(case: Case, seed: int) -> made.Made:
    return make.make(
        list(case.effects), [case.score] * len(case.effects), seed, case.clamped,
        case.calibration, case.simulator,
    )  # fmt: skip


def _dragged(case: Case, seed: int) -> made.Made:
    from benchmarks.discovery import dragging

    return dragging.make(seed, case.calibration)


def _film(case: Case, seed: int, recordings: Path, truths: Path) -> None:
    """Make a recording in motion, and one of the same rope at rest if that is to be known."""
    from benchmarks.discovery import filming

    moving, still = filming.make(case.effects[0], case.score, seed, case.clamped, case.calibration)
    names = {case.name: moving} | ({at_rest(case): still} if case.nominal else {})
    for k, (name, found) in enumerate(reversed(names.items())):
        made.write(recordings / name, truths / f"{name}.json", name, found, seed + k, case.group)
