"""The report as an answer: order of the page, three sentences, figures for papers, comparisons."""

import re

import pytest

from ropefit.artifacts import write
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
