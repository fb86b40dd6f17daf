"""Made-up artifacts of a small run, for tests of whatever shows them; pieces of a page."""

import json
import re

import numpy as np

from ropefit.artifacts import (
    Balance,
    Calibration,
    Control,
    Diagnosis,
    DroppedFrame,
    Exports,
    FittedModel,
    Iterated,
    Model,
    Observations,
    Parameter,
    ParameterGroup,
    Provenance,
    View,
)
from ropefit.artifacts.causes import Cause, Size
from ropefit.artifacts.diagnosis import Candidate, Detectable
from ropefit.artifacts.exports import Check, Export

F, K = 9, 6
EVIL = "<script>alert(1)</script>"
NOTICED = "A weight of 0.4 g on the rope would have been noticed."


def provenance(stage, **inputs):
    return Provenance(
        stage=stage,
        package_version="0.1.0",
        inputs=inputs or {"recording": "ab" * 32},
        settings={"nodes": K, "project": "auto"},
        settings_sha256="cd" * 32,
        created="2026-01-02T03:04:05+00:00",
        seconds=1.5,
    )


def ropes():
    """(F, K, 3) [m] hanging arcs."""
    s = np.linspace(0, np.pi, K)
    span = np.linspace(0.3, 0.5, F)[:, None]
    return np.stack([span * (1 - np.cos(s)) / 2, 0 * span * s, -0.3 * np.sin(s) + 0 * span], -1)


def observations(**changes):
    x = ropes()
    seen = np.ones((F, K - 1), dtype=bool)
    seen[2, 3] = False
    nan = np.full((F, 2, 4), np.nan)
    pixels = 600 * x[..., [0, 2]] * [1, -1] + [640, 360]
    content = {
        "provenance": provenance("preprocess"),
        "recording": "made-up",
        "recording_path": "/nowhere/made-up",
        "source": "clouds",
        "gravity": np.array([0, 0, -9.81]),
        "length": 1.0,
        "length_source": "recording",
        "mass": 0.05,
        "frames": np.arange(F) + 10,
        "time": np.arange(F) * 0.1,
        "dropped": [DroppedFrame(frame=19, reason="too few points")],
        "end_kind": ("pinned", "free"),
        "ends_assumed": False,
        "end_position": np.stack([x[:, 0], np.full((F, 3), np.nan)], axis=1),
        "end_orientation": nan,
        "points": x.reshape(-1, 3),
        "point_arc": np.tile(np.linspace(0, 1, K), F),
        "point_offset": np.zeros(F * K),
        "point_start": np.arange(F + 1) * K,
        "projected": True,
        "projection_reason": "it is flat",
        "plane_origin": x[:, 0],
        "plane_normal": np.tile([0.0, 1.0, 0.0], (F, 1)),
        "view": View(
            width=1280, height=720, fx=600, fy=600, cx=640, cy=360, pose=camera(), virtual=True
        ),
        "pixels": pixels.reshape(-1, 2),
        "pixel_arc": np.tile(np.linspace(0, 1, K), F),
        "pixel_start": np.arange(F + 1) * K,
        "node_arc": np.linspace(0, 1, K),
        "centreline": x,
        "centreline_px": pixels,
        "seen": seen,
        "lowest": x[:, K // 2],
        "noise": np.full(F, 0.001),
        "noise_source": "scatter of the points about the centreline",
    }
    return Observations(**content | changes)


def camera():
    """Looks along +y from one metre away, z up."""
    pose = np.eye(4)
    pose[:3, :3] = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]], dtype=float)
    pose[:3, 3] = [0.2, -1.0, 0.0]
    return pose


def fitted(heldout=True, converged=True):
    x, samples = ropes(), 4
    out = np.zeros(F, dtype=bool)
    out[4:6] = heldout
    common = {"lower": 0.01, "upper": 100.0, "meaning": "weight of something"}
    group = ParameterGroup(
        frames=np.arange(F) + 10,
        parameters={
            "eta_x_G": Parameter(
                **common | {"initial": 0.04, "value": 0.0512, "free": True},
                verdict="determined",
                ci95=(0.05, 0.0524),
            ),
            "eta_q_B": Parameter(
                **common | {"initial": 1, "value": 2, "free": True},
                verdict="trade-off",
                trades_with=["eta_x_D"],
            ),
            "eta_x_D": Parameter(**common, initial=1, value=1, free=False, verdict="fixed"),
        },
        free_names=["eta_x_G", "eta_q_B"],
        correlation=np.array([[1.0, np.nan], [np.nan, np.nan]]),
        condition=None,
        loss_before=2.0,
        loss_after=0.5,
        evaluations=12,
        converged=True,
        stop_reason="loss no longer decreases",
    )
    residual = np.full((F, K), 0.0012)
    residual[2, 3] = np.nan
    return FittedModel(
        solver="thomas",
        loss="OBJ1",
        search="gradient",
        control_node=0,
        fixed_nodes=[0],
        two_sided=False,
        groups={"group_0": group},
        heldout=out,
        x=x,
        q=np.tile([1.0, 0, 0, 0], (F, K - 1, 1)),
        x_initial=x + 0.01,
        residual=residual,
        rms=np.full(F, 0.0012),
        rms_initial=np.full(F, 0.01),
        rms_px=np.full(F, 0.7),
        iterated=Iterated(
            steps=10,
            iterations=30,
            dt=0.1,
            iteration=np.array([1, 10, 100, 300]),
            distance_violation=np.full((F, samples), 1e-4),
            length_error=np.full((F, samples), -1e-4),
            drift=np.full(F, 1e-4 if converged else 0.02),
            drift_allowed=1e-3,
        ),
        solver_converged=converged,
        trace=np.array([2.0, 1.0, 0.5]),
        rms_fit=0.0012,
        rms_heldout=0.0013 if heldout else None,
    )


def balanced(mass_known=True, lost=False, below=False):
    """A fit of the equilibrium model."""
    f = fitted()
    group = f.groups["group_0"]
    verdict = {"verdict": "flat direction", "below": 4e-5} if below else {"verdict": "determined"}
    bend = Parameter(
        meaning="bending rigidity", unit="N m^2" if mass_known else "m^3", initial=1e-4, value=7e-4,
        lower=1e-8, upper=1.0, free=True, ci95=None if below else (6.9e-4, 7.1e-4), **verdict,
    )  # fmt: skip
    group = group.model_copy(
        update={
            "parameters": {"EI": bend},
            "free_names": ["EI"],
            "correlation": np.eye(1),
            "loss_unit": "chi-square",
        }
    )
    converged = np.ones(F, dtype=bool)
    converged[3] = not lost
    other = np.full(F, np.nan)
    other[[5, 6]] = 0.12
    return f.model_copy(
        update={
            "solver": "equilibrium",
            "search": "least-squares",
            "iterated": None,
            "groups": {"group_0": group},
            "solver_converged": not lost,
            "balance": Balance(
                segments=80,
                newton=np.full(F, 4),
                residual=np.full(F, 1e-11),
                converged=converged,
                stability=np.where(converged, 0.01, np.nan),
                other=other,
                mass_known=mass_known,
                bending_length=0.113,
                calibration={
                    "end_0_x": Calibration(unit="m", prior=0.0015, value=0.006, sd=0.0002),
                    "scale": Calibration(unit="1", prior=0.003, value=0.001, sd=0.0005),
                },
                correlated_noise=0.0004,
                correlation_length=0.06,
            ),
        }
    )


def model(**kind):
    return Model(
        provenance=provenance("identify", **{"observations.h5": "ef" * 32}),
        recording="made-up",
        length=1.0,
        frames=np.arange(F) + 10,
        models={"nominal": fitted(**kind)},
    )


def control(kind="estimate"):
    x, nan = ropes(), np.full(F, np.nan)
    shape = kind == "shape"
    key = x[:, [2, 3]]
    return Control(
        provenance=provenance("control", **{"model.h5": "01" * 32}),
        kind=kind,
        loss_name="OBJ1",
        solver="thomas",
        control_node=0,
        moves_orientation=shape,
        cases=np.arange(F) + 10,
        start=x[:, 0],
        position=x[:, 0] + 0.002,
        orientation=np.full((F, 4), 0.5 if shape else np.nan),
        reference=x[:, 0] * (np.nan if shape else 1),
        deviation=nan if shape else np.full(F, 0.0035),
        deviation_px=nan if shape else np.full(F, 2.1),
        loss=np.ones(F),
        obj1=np.ones(F),
        position_sd=np.full((F, 3), 0.001),
        converged=np.arange(F) != 3,
        x=x,
        q=np.tile([1.0, 0, 0, 0], (F, K - 1, 1)),
        length_error=np.full(F, 1e-4),
        key_arc=np.tile([0.4, np.nan], (F, 1)),
        key_position=key,
        key_reference=key + 0.001,
        key_deviation=np.full((F, 2), 0.0017),
        key_deviation_px=np.full((F, 2), 1.0),
        length=1.0,
        notes=[f"a note {EVIL}"],
    )


def diagnosed(verdict="found", motion=""):
    """A diagnosis with one cause, or with none."""
    x, stations, knots = ropes(), 5, 4
    cause = Cause(
        name="point_mass",
        kind="physics",
        variant="PointMass",
        arc_length=(0.36, 0.38),
        frames=np.arange(F) + 10,
        parameters={"mass": Size(value=0.0041, unit="kg", ci95=(0.0038, 0.0044))},
        values=np.array([0.0041, 0.37]),
        value_names=["mass", "arc_length"],
        equivalent_to=["distributed_load"] if motion else [],
        log_evidence=410.0,
        p_value=1e-9,
        heldout_gain=np.array([80.0, 120.0, -2.0]),
        sentence="a mass of 4.1 g sits on the rope at 0.370 m",
    )
    scan = Candidate(
        name="point_mass",
        variant="PointMass",
        log_factor=400.0,
        score=28.0,
        place=np.linspace(0, 1, 6)[:, None],
        by_place=np.linspace(0, 400, 6),
    )
    force = np.zeros((F, knots, 3))
    force[:, 2, 2] = -0.3
    return Diagnosis(
        provenance=provenance("diagnose", **{"model.h5": "01" * 32}),
        recording="made-up",
        verdict=verdict,
        causes={"cause_0": cause} if verdict == "found" else {},
        scan={"00_point_mass": scan},
        mismatch=[],
        refused=[f"something {EVIL}"],
        threshold=9.0,
        noise_white=0.0012,
        noise_correlated=0.0,
        correlation_length=0.05,
        rms_before=0.0043,
        rms_after=0.0013,
        detectable={
            "point_mass": Detectable(value=4e-4, unit="kg", topic="weight", sentence=NOTICED)
        },
        motion=motion,
        separates=["point_mass", "distributed_load"] if motion else [],
        frames=np.arange(F) + 10,
        node_arc=np.linspace(0, 1, K),
        x_before=x,
        x_after=x + 0.001,
        station_arc=np.linspace(0.1, 0.9, stations),
        misfit_before=np.full((F, stations), 0.004),
        misfit_after=np.full((F, stations), 0.001),
        force_arc=np.linspace(0, 1, knots),
        force=force,
        force_sd=np.full((F, knots, 3), 0.05),
        force_evidence=20.0,
        force_threshold=12.0,
    )


def exported(off=0.002, failure="", other=np.nan, checked=True):
    """An export to two simulators, tried in one: every node `off` [m] from where it belongs."""
    x = ropes()[:2]
    failures = ["", failure]
    at_rest = x + np.array([0, off, 0])
    at_rest[1] = np.nan if failure else at_rest[1]
    check = Check(simulator="mujoco 4.0.1", x=at_rest, failures=failures) if checked else None
    common = {"frames": np.array([10, 11]), "x": x, "sha256": "23" * 32, "effects": ["point_mass"]}
    common["other"] = np.array([other, np.nan])
    notes = [f"a note on the text {EVIL}"]
    return Exports(
        provenance=provenance("export", **{"model.h5": "01" * 32}),
        length=1.0,
        exports={
            "mujoco": Export(file="rope.xml", notes=notes, check=check, **common),
            "json": Export(file="rope.json", notes=[], **common),
        },
    )


def titles(page):
    """Of the sections that are seen at first."""
    return re.findall(r"<h2>(.*?)</h2>", page)


def folded(page):
    """Titles of the sections that are opened by a click."""
    return re.findall(r"<summary>(.*?)</summary>", page)


def headline(page):
    return re.findall(r"<h1>(.*?)</h1>", page, re.S)[0]


def without_scripts(page):
    return re.sub(r"<script\b.*?</script>", "", page, flags=re.S)


def figures(page):
    found = re.findall(r'"></div><script type="application/json">(.*?)</script>', page)
    return [json.loads(text) for text in found]
