"""The report as an answer: order of the page, three sentences, figures for papers, comparisons."""

import re

import numpy as np
import pytest

from ropefit.artifacts import write
from ropefit.artifacts.diagnosis import Size
from ropefit.errors import WrongUsage
from ropefit.reporting.answer import answer
from ropefit.reporting.comparison import render_comparison
from ropefit.reporting.printed import print_figures
from ropefit.reporting.report import RunContents, figures_of, render_report
from ropefit.stages.report import compare_runs
from tests.report_runs import (
    EVIL,
    balanced,
    control,
    diagnosed,
    exported,
    figures,
    model,
    observations,
    titles,
    without_scripts,
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
    assert rope.startswith("This is a rope 1 m long, 50 g, held but free to turn at the gripper’s")
    assert "bending rigidity (EI) is 7.000·10⁻⁴ N·m² (95 % interval" in rope
    assert "comes within 1.3 mm" in fit
    assert "a mass of 4.1 g sits on the rope at 0.370 m; with that" in missing
    assert "falls from 3.6 to 1.1 times what noise alone would leave" in missing
    assert (
        "(this recording cannot tell it from: distributed load)"
        in (told(diagnosed(motion="lift"))[2])
    )
    little = diagnosed().model_copy(update={"rms_before": 0.00135})
    assert "less than single points scatter, but beyond chance" in told(little)[2]
    assert "all of them together do" in told(little)[1]
    along = Size(value=8 * 7e-4, unit="N m^2", ci95=(5.5e-3, 5.7e-3))
    with_it = told(diagnosed().model_copy(update={"rope": {"EI": along}}))[0]
    assert "(EI) is 0.005600 N·m² (95 % interval 0.005500 to 0.005700)" in with_it
    assert "a piece of it 210 mm long" in with_it  # twice as long for eight times the stiffness
    clean = told(diagnosed("none"))
    assert clean[2].startswith("Nothing was missing")
    assert "a weight of 0.40 g on the rope would have been noticed" in clean[2]
    assert "no effect that ropefit knows explains it" in told(diagnosed("unknown"))[2]
    assert told(None)[2].endswith("run ropefit diagnose.")
    assert len(answer(RunContents(observations()))) == 2


def test_what_did_not_arrive_is_in_the_three_sentences():
    def fit(made):
        whole = model().model_copy(update={"models": {"nominal": made}})
        return answer(RunContents(observations(), whole, None, diagnosed("none")))[1]

    assert "; but" not in fit(balanced())
    assert "; but in 1 of 9 frames no resting shape was found" in fit(balanced(lost=True))
    group = balanced().groups["group_0"].model_copy(update={"converged": False})
    early = balanced().model_copy(update={"groups": {"group_0": group}})
    assert "the search stopped before it arrived, so its numbers are provisional" in fit(early)
    weights = model(converged=False).nominal
    assert "(it would move another 20 mm), so the numbers belong to this simulation" in fit(weights)


def test_stiffness_is_told_as_a_hand_would_feel_it():
    """A level cantilever of small slope droops by l^4 w / (8 EI), whatever the rope's length."""
    soft = balanced()  # bending length 113 mm: l^3 = 0.8 (EI/w) droops by l/10
    assert "a piece of it 105 mm long" in _first(soft)  # 0.8^(1/3) 113 mm
    stiff = soft.balance.model_copy(update={"bending_length": 2.0})
    stiff = soft.model_copy(update={"balance": stiff})
    assert "the whole of it would droop by only 16 mm" in _first(stiff)  # 1 m / (8 * 2^3)
    assert "droop" not in _first(balanced(below=True))


def _first(made):
    whole = model().model_copy(update={"models": {"nominal": made}})
    return answer(RunContents(observations(), whole))[0]


def test_exports_tell_their_deviation_or_the_reason():
    def page(**kind):
        made = model().model_copy(update={"models": {"nominal": balanced()}})
        run = RunContents(observations(), made, None, None, exported(**kind))
        text = render_report(run)
        assert EVIL not in text
        assert "json: rope.json was written." in text
        return text

    good = page()
    assert "At rest in mujoco 4.0.1, in 2 poses of this recording, no point of the exported" in good
    assert "farther than 0.20 % of its length (2.0 mm)" in good
    assert "The exported rope at rest in mujoco" in good
    assert "exports.h5" in without_scripts(good).split("<h2>Provenance</h2>")[1]
    far = page(off=0.03, other=0.04)
    assert "up to 3.0 % of its length (30 mm)" in far
    assert "in frame 10 a second stable equilibrium is known, 40 mm away" in far
    assert "the simulator cannot express everything" in far  # of the other frame
    lost = page(failure="still moves")
    assert "In 1 pose (frame 11) it did not come to rest: still moves." in lost
    untried = page(checked=False)
    assert "The exported rope at rest" not in untried
    assert "mujoco: rope.xml was written but not tried; ropefit export --check" in untried


def test_markers_are_shown_one_by_one():
    """The fixture's points are its nodes: a model that is 10 mm off in x is 10 mm off here."""
    made = model()
    off = made.nominal.model_copy(update={"x": made.nominal.x + np.array([0.01, 0, 0])})
    run = RunContents(
        observations(source="markers"), made.model_copy(update={"models": {"nominal": off}})
    )
    page = render_report(run)
    assert titles(page)[1:3] == ["Overlay", "Predicted and recorded"]
    assert "10 mm (rms, in space)" in page
    tracks = next(f for f in figures(page) if "from end 0" in str(f["data"][0].get("name")))
    for simulated, recorded in zip(tracks["data"][::2], tracks["data"][1::2], strict=True):
        np.testing.assert_allclose(simulated["y"], recorded["y"], atol=1e-4)
    assert "Predicted and recorded" not in titles(render_report(RunContents(observations(), made)))


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
    one, other = run(7e-4, "a"), run(7.1e-4, "b")
    assert "EI in every run" in render_comparison([one, other])
    fit = other[1].model.nominal
    group = fit.groups["group_0"]
    ratio = group.parameters["EI"].model_copy(update={"unit": "m^3"})
    group = group.model_copy(update={"parameters": {"EI": ratio}})
    fit = fit.model_copy(update={"groups": {"group_0": group}})
    made = model().model_copy(update={"models": {"nominal": fit}})
    mixed = render_comparison([one, ("b", RunContents(observations(), made))])
    assert "EI in every run" not in mixed  # one of each unit: nothing to draw together
    (tmp_path / "x").mkdir()
    write(tmp_path / "x" / "observations.h5", observations())
    with pytest.raises(WrongUsage, match="twice"):
        compare_runs([tmp_path / "x", tmp_path / "x"], tmp_path / "c.html")
