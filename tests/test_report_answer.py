"""The report as an answer: its line, picture and reasons; figures for papers, comparisons."""

import re

import numpy as np
import pytest

from ropefit.artifacts import write
from ropefit.artifacts.causes import Curve, Law, Size
from ropefit.effects import CATALOGUE
from ropefit.errors import WrongUsage
from ropefit.reporting.answer import answer
from ropefit.reporting.comparison import render_comparison
from ropefit.reporting.glyphs import Place, band, drawn_of, label_of, strokes
from ropefit.reporting.printed import print_figures
from ropefit.reporting.report import RunContents, figures_of, render_report
from ropefit.reporting.sections.why import candidates
from ropefit.reporting.words import common_power, number, strength
from ropefit.stages.report import compare_runs
from tests.concealed import rope
from tests.report_runs import (
    EVIL,
    K,
    balanced,
    control,
    diagnosed,
    exported,
    figures,
    folded,
    model,
    observations,
    ropes,
    titles,
    without_scripts,
)


def test_the_whole_page_in_the_order_of_a_readers_questions():
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    run = RunContents(observations(), made, control(), diagnosed(motion="lift the gripper"))
    page = render_report(run)
    assert titles(page) == [
        "Where", "Why this and not that", "How sure", "Parameters", "What to do next",
    ]  # fmt: skip
    assert folded(page) == [
        "All candidates", "The fit in detail", "Control", "Solver", "Observations", "Provenance",
    ]  # fmt: skip
    assert EVIL not in page
    assert "To tell point mass and distributed load apart, lift the gripper." in page
    assert "Gain in held-out blocks" in page
    assert "diagnosis.h5" in without_scripts(page).split("<summary>Provenance")[1]
    clean = render_report(RunContents(observations(), made, None, diagnosed("none")))
    assert "no further motion is asked for" in clean
    assert titles(clean) == [title for title in titles(page) if title != "How sure"]


def traces(page):
    """The traces of the picture and, by name, what they are in its first step."""
    picture = figures(page)[0]
    return picture, {
        trace["name"]: step
        for trace, step in zip(picture["data"], picture["steps"][0], strict=True)
    }


def test_the_picture_shows_the_cause_where_it_is():
    made = model().model_copy(update={"models": {"nominal": balanced()}})

    def page(d):
        return render_report(RunContents(observations(), made, None, d))

    picture, first = traces(page(diagnosed()))
    assert list(first)[:3] == ["recorded", "nominal", "with the cause"]
    colours = [t.get("line", t.get("marker"))["color"] for t in picture["data"][:4]]
    assert len(set(colours)) == 4
    assert picture["enlarged"][:2] == [1, 2]
    label = picture["steps"][0][5]
    assert picture["data"][5]["text"] == ["4.10 g"]
    rope = np.array([first["with the cause"][k] for k in "xyz"]).T
    at = rope[round(0.37 * (len(rope) - 1))]
    assert np.linalg.norm(np.array([label[k][0] for k in "xyz"]) - at) < 0.2
    hangs = [z for z in first["point mass"]["z"] if z is not None]
    assert at[2] - 0.15 < min(hangs) < max(hangs) <= at[2] + 0.15
    assert len(rope) > 4 * K  # drawn through a spline, not in straight pieces
    _, plain = traces(page(diagnosed("none")))
    assert list(plain) == ["recorded", "nominal", "ends"]


def test_arrows_of_force_only_where_the_evidence_is_beyond_chance():
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    force = "force that would explain what is left"

    def drawn(**changes):
        d = diagnosed("unknown").model_copy(update=changes)
        return traces(render_report(RunContents(observations(), made, None, d)))[1]

    arrows = drawn()[force]
    assert sum(v is None for v in arrows["z"]) == 2  # one knot's force is beyond its error
    assert force not in drawn(force_evidence=11.0)


@pytest.mark.parametrize("kind", CATALOGUE, ids=lambda kind: kind.__name__)
def test_every_effect_is_drawn(kind):
    """Its symbol consists of lines near the rope, in a recording of any gravity."""
    effect = kind(1)
    values = {q.name: 0.5 * min(q.upper, 1.0) for q in effect.quantities}
    values |= {"arc_length": 0.4, "centre": 0.5, "width": 0.3}
    drawn = effect.drawn(values, np.array([0.0, 0.0, -9.81]))
    arc = np.linspace(0, 1, K)
    end = 1 if effect.locus == "end" else None
    up, side = np.eye(3)[2], np.eye(3)[0]
    place = Place(ropes()[0], arc, (0.35, 0.65), end, np.zeros(3), up, side)
    lines, label = strokes(drawn, place)
    assert np.isfinite(label).all()
    if (
        drawn.symbol == "stretch"
    ):  # a stretch is a picture only of what has one; a law has its graph
        assert "width" in effect.names or effect.law(rope(4)) is not None
    else:
        assert np.isfinite(lines).all(axis=1).sum() >= 2
        assert np.nanmax(np.abs(lines)) < 3
    assert len(band(place)) > 2


def test_a_law_is_drawn_as_its_curve():
    x = np.linspace(0.5, 8, 20)
    curve = Curve(
        name_x="curvature", unit_x="1/m", name_y="moment", unit_y="N m", x=x, y=x**0.5, low=x,
        high=x, visited=(1.0, 6.0),
    )  # fmt: skip
    law = Law(form="", forms=[], parameters={}, curve=curve)
    cause = (
        diagnosed()
        .causes["cause_0"]
        .model_copy(
            update={"variant": "BendingLaw", "law": law, "value_names": ["exponent"]}
            | {"values": np.array([-0.5]), "arc_length": None}
        )
    )
    drawn = drawn_of(cause, np.array([0, 0, -9.81]))
    assert (drawn.symbol, label_of(cause, drawn)) == ("graph", "moment over curvature")
    assert drawn.curve is not None
    assert (drawn.curve[:, 0] > 0.9).all()
    assert (drawn.curve[:, 0] < 6.1).all()  # where the data are
    lines, _ = strokes(
        drawn,
        Place(ropes()[0], np.linspace(0, 1, K), (0, 1), None, np.zeros(3), *np.eye(3)[[2, 0]]),
    )
    rising = lines[np.isfinite(lines).all(axis=1)][-len(drawn.curve) :]
    slope = np.diff(rising[:, 2]) / np.diff(rising[:, 0])
    assert (np.diff(slope) < 0).all()  # bent as the square root is


def test_numbers_that_are_compared_share_a_power_of_ten():
    power = common_power([1.004e-3, 9.651e-4])
    assert (number(1.004e-3, 4, power), number(9.651e-4, 4, power)) == ("1.004·10⁻³", "0.9651·10⁻³")
    assert common_power([0.2, 0.3]) is None  # none is needed
    assert common_power([1e-9, 1.0]) is None  # too far apart
    assert number(9.651e-4, 4) == "9.651·10⁻⁴"


def test_why_this_and_not_that():
    d = diagnosed(motion="lift the gripper")
    other = d.scan["00_point_mass"].model_copy(update={"name": "tether", "log_factor": 7.0})
    d = d.model_copy(update={"scan": {**d.scan, "01_tether": other}})
    rows = candidates(d)
    assert [(r.name, r.accepted, r.tied) for r in rows] == [
        ("point_mass", True, True), ("distributed_load", False, True), ("tether", False, False),
    ]  # fmt: skip
    assert strength(5.0, 9.0) == "weak"
    assert strength(10.0, 9.0) == "strong"
    assert strength(14.0, 9.0) == "decisive"
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    page = render_report(RunContents(observations(), made, None, d))
    assert page.count('<li class="accepted tied">') == 1
    assert page.count('<li class="tied">') == 1
    assert "decisive, 410 nats, accepted" in page
    assert "Refused: something &lt;script" in page


def test_intervals_are_judged_by_what_was_held_out():
    made = model().model_copy(update={"models": {"nominal": balanced()}})

    def page(pit):
        d = diagnosed().model_copy(update={"pit": pit})
        return render_report(RunContents(observations(), made, None, d))

    even = (np.arange(1000) + 0.5) / 1000
    assert "hold 95.0 % of them: the stated uncertainties are honest" in page(even)
    tails = np.where(even < 0.5, even**2, 1 - (1 - even) ** 2)
    assert "too narrow for this recording" in page(tails)


def test_what_no_motion_separates_is_said():
    made = model().model_copy(update={"models": {"nominal": balanced()}})

    def page(apart):
        x = np.stack([ropes()[:5], ropes()[:5] + np.array([0, apart, 0])])
        d = diagnosed(motion="lift the gripper").model_copy(update={"motion_x": x})
        return render_report(RunContents(observations(), made, None, d))

    assert "To tell point mass and distributed load apart, lift the gripper." in page(0.01)
    assert "would look alike under every motion tried" in page(0.0001)
    assert "differ by 0.10 mm, where noise is 1.2 mm" in page(0.0001)


def test_the_answer_in_one_line():
    made = model().model_copy(update={"models": {"nominal": balanced()}})

    def told(d):
        return answer(RunContents(observations(), made, None, d))

    line, rope = told(diagnosed())
    assert line == (
        "A mass of 4.1 g sits on the rope at 0.370 m: the error on unseen data falls from 4.30 mm "
        "to 1.30 mm; noise is 1.20 mm."
    )
    assert rope.startswith("This is a rope 1 m long, 50 g, held but free to turn at the gripper’s")
    assert "bending rigidity (EI) is 7.000·10⁻⁴ N·m² (95 % interval" in rope
    assert "It may also be: distributed load." in told(diagnosed(motion="lift"))[1]
    little = diagnosed().model_copy(update={"rms_before": 0.001301})
    assert "that moves the rope less than single points scatter" in told(little)[0]
    along = Size(value=8 * 7e-4, unit="N m^2", ci95=(5.5e-3, 5.7e-3))
    with_it = told(diagnosed().model_copy(update={"rope": {"EI": along}}))[-1]
    assert "(EI) is 0.005600 N·m² (95 % interval 0.005500 to 0.005700)" in with_it
    assert "a piece of it 210 mm long" in with_it  # twice as long for eight times the stiffness
    assert "what is left is not explained" in told(diagnosed("none"))[0]
    clean = told(diagnosed("none").model_copy(update={"rms_before": 0.00125}))
    assert clean[0].startswith("Nothing is missing that this recording could show")
    assert clean[-1] == "A weight of 0.4 g on the rope would have been noticed."
    assert "no effect ropefit knows explains" in told(diagnosed("unknown"))[0]
    assert told(None)[-1].endswith("run ropefit diagnose.")
    assert len(answer(RunContents(observations()))) == 2


def test_one_before_and_after_and_one_noise():
    """With a cause, the page tells no second pair of errors and no second noise of a point."""
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    text = without_scripts(render_report(RunContents(observations(), made, None, diagnosed())))
    assert text.count("4.30 mm") == text.count("1.30 mm") == 1
    assert set(re.findall(r"[Nn]oise (?:is|of a point)[^.]*?([\d.]+) mm", text)) == {"1.20"}
    assert "1.0 mm" not in text  # what preprocess took the noise to be
    assert "10 mm" not in text  # before the fit


def test_what_did_not_arrive_stands_under_the_answer():
    def fit(made):
        whole = model().model_copy(update={"models": {"nominal": made}})
        return " ".join(answer(RunContents(observations(), whole, None, diagnosed("none"))))

    assert "stopped" not in fit(balanced())
    assert "In 1 of 9 frames no resting shape was found" in fit(balanced(lost=True))
    group = balanced().groups["group_0"].model_copy(update={"converged": False})
    early = balanced().model_copy(update={"groups": {"group_0": group}})
    assert "The search stopped before it arrived: its numbers are provisional" in fit(early)
    weights = model(converged=False).nominal
    assert "(it would move another 20 mm): the numbers belong to this simulation" in fit(weights)


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
    return answer(RunContents(observations(), whole))[1]


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
    assert "exports.h5" in without_scripts(good).split("<summary>Provenance")[1]
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
    assert folded(page)[0] == "Predicted and recorded"
    assert "10 mm (rms, in space)" in page
    tracks = next(f for f in figures(page) if "from end 0" in str(f["data"][0].get("name")))
    for simulated, recorded in zip(tracks["data"][::2], tracks["data"][1::2], strict=True):
        np.testing.assert_allclose(simulated["y"], recorded["y"], atol=1e-4)
    assert "Predicted and recorded" not in folded(render_report(RunContents(observations(), made)))


def test_figures_for_papers(tmp_path):
    matplotlib = pytest.importorskip("matplotlib")
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    run = RunContents(observations(), made, control(), diagnosed())
    drawn = figures_of(run)
    assert len(drawn) == len(figures(render_report(run)))
    few = [f for f in drawn if f.name in ("Score scan",)]
    files = print_figures([*few, drawn[0]], tmp_path / "figures", ["svg", "png"])
    assert len(files) == 2 * (1 + 3)  # three frames of a slider
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
    assert "A mass of 4.1 g sits on the rope" in page
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
