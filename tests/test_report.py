"""The report: complete, self-contained, honest, and drawn by a browser."""

import json
import re
import shutil
import subprocess

import numpy as np
import plotly.graph_objects as go
import pytest

from ropefit.artifacts import (
    Balance,
    Calibration,
    Control,
    Diagnosis,
    DroppedFrame,
    FittedModel,
    Iterated,
    Model,
    Observations,
    Parameter,
    ParameterGroup,
    Provenance,
    View,
    write,
)
from ropefit.artifacts.diagnosis import Candidate, Cause, Detectable, Size
from ropefit.errors import StageFailed, WrongUsage
from ropefit.reporting.answer import answer
from ropefit.reporting.comparison import render_comparison
from ropefit.reporting.printed import print_figures
from ropefit.reporting.report import RunContents, figures_of, render_report
from ropefit.reporting.words import number, ranges, symbol
from ropefit.stages.report import compare_runs, write_report

F, K = 9, 6
IN_ORDER = ["Summary", "Overlay", "Where it differs", "Parameters"]
IN_ORDER += ["Control", "Solver", "Observations", "Provenance"]
EVIL = "<script>alert(1)</script>"


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


def test_an_equilibrium_model_is_told_in_units_with_limits_and_calibration():
    def page(**kind):
        made = model().model_copy(update={"models": {"nominal": balanced(**kind)}})
        return render_report(RunContents(observations(), made))

    full = page()
    assert titles(full) == [title for title in IN_ORDER if title != "Control"]
    assert "(EI) is 7.000·10⁻⁴ N·m² (95 % interval 6.900·10⁻⁴ to 7.100·10⁻⁴)" in full
    assert "In 2 frames (15–16) a second stable equilibrium exists" in full
    row = re.search(r"<tr><td[^>]*>end 0 x</td>.*?</tr>", full, re.S).group()
    for cell in (">1.5<", ">6.0<", ">0.20<", ">mm<", "far outside"):
        assert cell in row
    assert "χ²" in full
    assert "loss (m)" not in full
    assert "fix only ratios" not in full
    unknown = page(mass_known=False)
    assert "shapes alone fix only ratios" in unknown
    assert "113 mm" in unknown or "0.113 m" in unknown
    assert "is below 4.00·10⁻⁵ N·m²" in page(below=True)
    lost = page(lost=True)
    assert "1 frame of 9 reached no equilibrium (13)" in lost
    assert "not converged" in json.dumps(figures(lost))
    assert "reached no equilibrium" not in full


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
        detectable={"point_mass": Detectable(value=0.0004, unit="kg")},
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


def test_the_whole_page_in_the_order_of_a_readers_questions():
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    run = RunContents(observations(), made, control(), diagnosed(motion="lift the gripper"))
    page = render_report(run)
    assert titles(page) == [
        "Summary", "Overlay", "Where it differs", "What was left out", "Parameters", "Control",
        "Solver", "Next motion", "Observations", "Provenance",
    ]  # fmt: skip
    assert EVIL not in page
    assert "To tell point mass and distributed load apart, lift the gripper." in page
    assert "force beyond two standard deviations" in page
    assert "Gain in held-out frames" in page
    assert "diagnosis.h5" in without_scripts(page).split("<h2>Provenance</h2>")[1]
    arrows = next(f for f in figures(page) if f["data"][0].get("name") == "rope")
    _, unsure, sure = arrows["steps"][0]
    assert sum(v is None for v in unsure["z"]) == 3
    assert sum(v is None for v in sure["z"]) == 1  # one knot's force is beyond its error
    clean = render_report(RunContents(observations(), made, None, diagnosed("none")))
    assert "force beyond two standard deviations" not in clean
    assert "no further motion is asked for" in clean


def test_three_sentences():
    made = model().model_copy(update={"models": {"nominal": balanced()}})

    def told(d):
        return answer(RunContents(observations(), made, None, d))

    rope, fit, missing = told(diagnosed())
    assert rope.startswith("This is a rope 1 m long, 50 g, pinned at the gripper’s end and free")
    assert "bending rigidity (EI) is 7.000·10⁻⁴ N·m² (95 % interval" in rope
    assert "lies 1.3 mm (rms)" in fit
    assert "a mass of 4.1 g sits on the rope at 0.370 m; with it" in missing
    assert "1.3 mm (rms) instead of 4.3 mm, noise being 1.2 mm" in missing
    assert "(or as well distributed_load)" in told(diagnosed(motion="lift"))[2]
    assert told(diagnosed("none"))[2].startswith("Nothing was missing")
    assert "no known effect explains" in told(diagnosed("unknown"))[2]
    assert told(None)[2].endswith("run ropefit diagnose.")
    assert len(answer(RunContents(observations()))) == 2


def test_figures_for_papers(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    run = RunContents(observations(), made, control(), diagnosed())
    drawn = figures_of(run)
    assert len(drawn) == len(figures(render_report(run)))
    few = [f for f in drawn if f.name in ("Score scan", "Latent force along the rope")]
    files = print_figures([*few, drawn[1]], tmp_path / "figures", ["svg", "png"])
    assert len(files) == 2 * (1 + 3 + 3)  # three frames of a slider
    svg = next(path for path in files if "score-scan" in path.name and path.suffix == ".svg")
    text = svg.read_text()
    width = float(re.search(r'width="([\d.]+)pt"', text)[1])
    assert width == pytest.approx(86 / 25.4 * 72, abs=0.1)
    assert "point mass" in text  # text stays text
    image = matplotlib.image.imread(svg.with_suffix(".png"))
    assert image.shape[1] == pytest.approx(86 / 25.4 * 300, abs=2)
    assert image[..., :3].std() > 0.05


def test_comparison_of_runs(tmp_path):
    def run(value, name):
        fit = balanced()
        p = fit.groups["group_0"].parameters["EI"]
        p = p.model_copy(update={"value": value, "ci95": (0.98 * value, 1.02 * value)})
        group = fit.groups["group_0"].model_copy(update={"parameters": {"EI": p}})
        fit = fit.model_copy(update={"groups": {"group_0": group}})
        made = model().model_copy(update={"models": {"nominal": fit}})
        return name, RunContents(observations(), made, None, diagnosed())

    page = render_comparison([run(7e-4, "a"), run(7.1e-4, "b"), run(9e-4, EVIL)])
    assert EVIL not in page
    assert "EI differs beyond its 95 % intervals between a and &lt;" in page
    assert "a mass of 4.1 g sits on the rope" in page
    assert "EI agrees within its 95 % intervals in 1 pair." in render_comparison(
        [run(7e-4, "a"), run(7.1e-4, "b")]
    )
    (tmp_path / "x").mkdir()
    write(tmp_path / "x" / "observations.h5", observations())
    with pytest.raises(WrongUsage, match="twice"):
        compare_runs([tmp_path / "x", tmp_path / "x"], tmp_path / "c.html")


def titles(page):
    return re.findall(r"<h2>(.*?)</h2>", page)


def without_scripts(page):
    return re.sub(r"<script\b.*?</script>", "", page, flags=re.S)


def figures(page):
    found = re.findall(r'px"></div><script type="application/json">(.*?)</script>', page)
    return [json.loads(text) for text in found]


@pytest.fixture(scope="module")
def full():
    return render_report(RunContents(observations(), model(), control()))


def test_every_section_in_order(full):
    assert titles(full) == IN_ORDER


def test_sections_without_their_artifact_are_left_out():
    assert titles(render_report(RunContents(observations(), model()))) == [
        title for title in IN_ORDER if title != "Control"
    ]
    bare = render_report(RunContents(observations()))
    assert titles(bare) == ["Summary", "Overlay", "Observations", "Provenance"]
    assert "No simulation has been fitted" in bare


def test_loads_nothing_from_anywhere(full):
    html = without_scripts(full)
    assert not re.search(r"""(src|href|action)\s*=\s*["'](?!#)""", html)
    assert "http://" not in html
    assert "https://" not in html
    assert not re.search(r"<script[^>]+src", full)
    assert not re.search(r"url\(|@import", html)
    assert full.count("plotly.js v") == 1
    assert "default-src 'none'" in full
    assert len(full.encode()) < 12e6


def test_the_same_artifacts_give_the_same_page(full):
    assert render_report(RunContents(observations(), model(), control())) == full


def test_untrusted_text_is_escaped():
    dropped = [DroppedFrame(frame=1, reason=EVIL)]
    seen = observations(recording=EVIL, projection_reason=EVIL, noise_source=EVIL, dropped=dropped)
    page = render_report(RunContents(seen, model(), control()))
    assert EVIL not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page


def test_heldout_frames_are_told():
    page = render_report(RunContents(observations(), model()))
    assert "In 2 frames that the fit never saw, the simulated rope lies 1.3 mm (rms)" in page
    without = render_report(RunContents(observations(), model(heldout=False)))
    assert "no frame was held out" in without
    assert "No frame was held out: how well the fit predicts unseen frames is not known." in without


def test_an_unconverged_solver_is_told():
    page = render_report(RunContents(observations(), model(converged=False)))
    assert "The solver has not converged" in page
    assert "depend on the iteration count and are not properties of the rope" in page
    assert "weights of the paper’s simulation, which are no properties of a rope" in page
    assert "not properties" not in render_report(RunContents(observations(), model()))


def test_assumed_ends_are_told(full):
    assert "the ends seen were taken as pinned" not in full
    page = render_report(RunContents(observations(ends_assumed=True)))
    assert "the ends seen were taken as pinned" in page


def test_parameters_come_with_interval_and_verdict(full):
    row = re.search(r'<tr>(?:(?!</tr>).)*title="eta_x_G".*?</tr>', full, re.S).group()
    assert "0.05000 … 0.05240" in row or "0.0500 … 0.0524" in row
    assert "determined" in row
    row = re.search(r'<tr><td[^>]*><span title="eta_q_B".*?</tr>', full, re.S).group()
    assert "trade-off" in row
    assert "none" in row
    assert str(symbol("eta_x_D")) in row


def test_control_tells_deviations_and_poses(full):
    assert "8 of 9 frames" in full
    assert "deviation of the control point (px)" in full
    page = render_report(RunContents(observations(), model(), control("shape")))
    assert "Pose reached" in page
    assert "0.5000, 0.5000, 0.5000, 0.5000" in page
    assert "anywhere" in page


def test_figures_are_valid_and_have_units(full):
    plots = figures(full)
    assert len(plots) >= 12
    for plot in plots:
        text = json.dumps(plot).replace('"ink"', '"black"').replace('"soft"', '"grey"')
        clean = json.loads(text.replace('"band"', '"grey"'))
        go.Figure(data=clean["data"], layout=clean["layout"])  # raises on an unknown property
        for name, axis in plot["layout"].items():
            if re.match(r"[xy]axis", name) and axis["title"]["text"]:
                title = axis["title"]["text"]
                assert title in ("frame", "iteration", "step of the search") or "(" in title


def test_long_recordings_are_thinned():
    many = 200
    x = np.tile(ropes(), (23, 1, 1))[:many]
    long = observations(
        frames=np.arange(many),
        time=np.arange(many) * 0.1,
        end_position=np.stack([x[:, 0], x[:, -1]], axis=1),
        end_orientation=np.full((many, 2, 4), np.nan),
        points=x.reshape(-1, 3),
        point_arc=np.tile(np.linspace(0, 1, K), many),
        point_offset=np.zeros(many * K),
        point_start=np.arange(many + 1) * K,
        plane_origin=x[:, 0],
        plane_normal=np.tile([0.0, 1.0, 0.0], (many, 1)),
        pixels=x.reshape(-1, 3)[:, :2],
        pixel_arc=np.tile(np.linspace(0, 1, K), many),
        pixel_start=np.arange(many + 1) * K,
        centreline=x,
        centreline_px=x[..., :2],
        seen=np.ones((many, K - 1), dtype=bool),
        lowest=x[:, 0],
        noise=np.full(many, 0.001),
    )
    page = render_report(RunContents(long))
    assert "60 of 200 frames are shown, evenly chosen." in page
    assert len(figures(page)[0]["steps"]) == 60


def test_written_into_the_run(tmp_path):
    with pytest.raises(StageFailed, match=r"no observations\.h5"):
        write_report(tmp_path, print)
    digest = write(tmp_path / "observations.h5", observations())
    said = []
    path = write_report(tmp_path, said.append)
    assert path == tmp_path / "report.html"
    assert "model.h5 and control.h5" in said[0]
    fresh = model().model_copy(
        update={"provenance": provenance("identify", **{"observations.h5": digest})}
    )
    write(tmp_path / "model.h5", fresh)
    write_report(tmp_path, said.append)
    assert "<h2>Solver</h2>" in path.read_text(encoding="utf-8")
    assert sorted(p.name for p in tmp_path.iterdir()) == [
        "model.h5",
        "observations.h5",
        "report.html",
    ]
    write(tmp_path / "observations.h5", observations(recording="another"))
    with pytest.raises(StageFailed, match="stale"):
        write_report(tmp_path, said.append)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.0, "1.00"),
        (12345.0, "12300"),
        (-0.25, "−0.250"),
        (9.999, "10.0"),
        (1.5e-6, "1.50·10⁻⁶"),
        (float("nan"), "–"),
        (None, "–"),
    ],
)
def test_numbers(value, text):
    assert number(value) == text


def test_ranges():
    assert ranges([3, 1, 2, 7, 9, 10]) == "1–3, 7, 9–10"


@pytest.mark.parametrize("kind", ["estimate", "shape"])
def test_a_browser_draws_it(tmp_path, kind):
    browser = shutil.which("chromium") or shutil.which("google-chrome")
    if browser is None:
        pytest.skip("no Chromium on this machine")
    page = tmp_path / "report.html"
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    run = RunContents(observations(), made, control(kind), diagnosed("unknown"))
    text = render_report(run)
    move = "const s = document.querySelector('input'); s.value = 5;"
    move += "s.dispatchEvent(new Event('input'));"
    moved = text.replace("</body>", f"<script>{move}</script></body>")
    page.write_text(moved, encoding="utf-8")
    flags = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-unsafe-swiftshader"]
    flags += ["--virtual-time-budget=8000", "--enable-logging=stderr", "--v=0"]
    flags += [f"--user-data-dir={tmp_path / 'profile'}", "--dump-dom", page.as_uri()]
    command = [browser, *flags]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    drawn = re.findall(r'<svg class="main-svg"', done.stdout)
    assert len(drawn) >= len(figures(text))
    assert "<output>Frame 15, 0.50 s, held out</output>" in done.stdout
    told = [line for line in done.stderr.splitlines() if "CONSOLE" in line or "Uncaught" in line]
    wrong = [line for line in told if not re.search("Multiple readback|GL Driver Message", line)]
    assert not wrong
