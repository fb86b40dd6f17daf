"""The report: complete, self-contained, honest, and drawn by a browser."""

import json
import re
import warnings

import numpy as np
import pytest

from ropefit.artifacts import DroppedFrame, write
from ropefit.artifacts.causes import Size
from ropefit.cli.diagnose import size_text
from ropefit.errors import StageFailed
from ropefit.reporting.report import RunContents, render_report
from ropefit.reporting.words import number, ranges, symbol, with_unit
from ropefit.stages.report import write_report
from tests import chromium
from tests.report_runs import (
    EVIL,
    K,
    balanced,
    control,
    diagnosed,
    exported,
    figures,
    folded,
    headline,
    model,
    observations,
    provenance,
    ropes,
    titles,
    without_scripts,
)

FIRST = ["Where", "Parameters"]
BELOW = ["The fit in detail", "Control", "Solver", "Observations", "Provenance"]


def test_an_equilibrium_model_is_told_in_units_with_limits_and_calibration():
    def page(**kind):
        made = model().model_copy(update={"models": {"nominal": balanced(**kind)}})
        return render_report(RunContents(observations(), made))

    full = page()
    assert titles(full) == FIRST
    assert folded(full) == [title for title in BELOW if title != "Control"]
    assert "(EI) is 7.000·10⁻⁴ N·m² (95 % interval 6.900·10⁻⁴ to 7.100·10⁻⁴)" in full
    assert "a piece of it 105 mm long, held level at one end, would droop by a tenth" in full
    assert "In 2 frames (15–16) a second stable equilibrium exists" in full
    row = re.search(r"<tr><td[^>]*>end 0 x \(mm\).*?</tr>", full, re.S).group()
    for cell in (">1.5<", ">6.0<", ">0.20<", "far outside"):
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


@pytest.fixture(scope="module")
def full():
    return render_report(RunContents(observations(), model(), control()))


def test_every_section_in_order(full):
    assert titles(full) == [*FIRST, "Keep in mind"]
    assert folded(full) == BELOW


def test_sections_without_their_artifact_are_left_out():
    made = render_report(RunContents(observations(), model()))
    assert folded(made) == [title for title in BELOW if title != "Control"]
    bare = render_report(RunContents(observations()))
    assert titles(bare) == []
    assert folded(bare) == ["Observations", "Provenance"]
    assert "No simulation has been fitted" in headline(bare)
    assert len(figures(bare)) == 2  # the picture, and what was seen


def test_loads_nothing_from_anywhere(full):
    html = without_scripts(full)
    assert not re.search(r"""(src|href|action)\s*=\s*["'](?!#)""", html)
    assert "http://" not in html
    assert "https://" not in html
    assert not re.search(r"<script[^>]+src", full)
    assert not re.search(r"url\(|@import", html)
    assert "default-src 'none'" in full
    assert len(full.encode()) < 3e5


def test_the_same_artifacts_give_the_same_page(full):
    assert render_report(RunContents(observations(), model(), control())) == full


def test_untrusted_text_is_escaped():
    dropped = [DroppedFrame(frame=1, reason=EVIL)]
    seen = observations(recording=EVIL, projection_reason=EVIL, noise_source=EVIL, dropped=dropped)
    page = render_report(RunContents(seen, model(), control()))
    assert EVIL not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page


def test_ranges_of_numbers():
    assert ranges([3, 1, 2, 7]) == "1–3, 7"
    assert ranges(range(4, 25, 4)) == "4, 8, 12, 16, 20, 24"
    assert ranges([*range(4, 150, 4), *range(154, 300, 4)]) == "4–148, 154–298 by 4"
    assert ranges([]) == ""


def test_heldout_frames_are_told():
    page = render_report(RunContents(observations(), model()))
    assert "predicts frames it was never shown to 1.3 mm; noise is 1.4 mm" in headline(page)
    without = render_report(RunContents(observations(), model(heldout=False)))
    assert "fits the recording to 1.2 mm (no frame was held out)" in headline(without)
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
    assert "no interval" in row
    assert str(symbol("eta_x_D")) in row
    assert full.count('<svg class="intervals"') == 1


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
        for trace in plot["data"]:
            assert trace["type"] in ("scatter", "scatter3d", "bar", "heatmap")
        for step in plot.get("steps", []):
            assert len(step) == len(plot["data"])
        for name in ("xaxis", "yaxis"):
            if title := plot["layout"].get(name, {}).get("title"):
                bare = ("frame", "iteration", "step of the search", "χ²", "Newton iterations")
                assert title in bare or "(" in title


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
    page = path.read_bytes()
    assert "Solver" in folded(page.decode())
    path.write_bytes(b"edited" + page)
    write_report(tmp_path, said.append)  # of the same artifacts: it stays
    assert path.read_bytes() == b"edited" + page
    write_report(tmp_path, said.append, force=True)
    assert path.read_bytes() == page
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


def test_shares_have_no_unit_where_a_person_reads():
    share = Size(value=0.97, unit="1", ci95=(0.9, 1.04))
    assert size_text("share", share) == "share 0.97 (0.9 .. 1.04)"
    assert size_text("mass", share.model_copy(update={"unit": "kg"})).endswith(") kg")
    assert with_unit("0.97", "1") == "0.97"
    assert with_unit("7.0", "N m^2") == "7.0 N·m²"
    d = diagnosed()
    two = {"share": share, "factor": share}
    cause = d.causes["cause_0"].model_copy(update={"parameters": two})
    d = d.model_copy(update={"causes": {"cause_0": cause}})
    page = render_report(RunContents(observations(), model(), None, d))
    row = re.search(r"<tr><td[^>]*>share of point mass</td>.*?</tr>", page, re.S).group()
    assert "A mass of 4.1 g sits on the rope at 0.370 m" in row  # the cause, not its kind
    row = re.search(r"<tr><td[^>]*>factor of point mass</td>.*?</tr>", page, re.S).group()
    assert "as above" in row
    assert '0.970 <span class="interval">0.900 … 1.04</span>' in page


def test_ranges():
    assert ranges([3, 1, 2, 7, 9, 10]) == "1–3, 7, 9–10"


@pytest.mark.parametrize("kind", ["estimate", "shape"])
def test_a_browser_draws_it(tmp_path, kind):
    """Answer, picture, cause, maps, slider; no complaint, no request; phone, dark, paper."""
    if chromium.BINARY is None:
        warnings.warn("no Chromium here: NO BROWSER HAS OPENED THE REPORT", stacklevel=1)
        pytest.skip("no Chromium on this machine")
    path = tmp_path / "report.html"
    made = model().model_copy(update={"models": {"nominal": balanced()}})
    found = diagnosed(motion="lift the gripper")
    text = render_report(RunContents(observations(), made, control(kind), found, exported()))
    path.write_text(text, encoding="utf-8")
    with chromium.Page(tmp_path / "profile") as page:
        page.open(path)
        top = page.run("document.querySelector('h1').getBoundingClientRect().bottom")
        assert top < page.run("document.querySelector('.main svg').getBoundingClientRect().top")
        assert page.run("document.querySelector('h1').textContent").startswith("A mass of 4.1 g")
        page.drawn()
        assert page.run("[...document.querySelectorAll('h2')].map(h => h.textContent)") == titles(
            text
        )
        assert page.run("document.querySelectorAll('.canvas > svg').length") == len(figures(text))
        assert page.run("document.querySelector('.main .halo').textContent") == "4.10 g"
        purple = "[...document.querySelectorAll('.main path')].filter(p => p.style.stroke ==="
        assert page.run(f"{purple} 'rgb(184, 71, 143)').length") >= 2  # the stretch and the weight
        shown = "document.querySelector('.main output').textContent"
        page.run(
            "(() => { const s = document.querySelector('.main input'); s.value = 5;"
            "s.dispatchEvent(new Event('input')); })()"
        )
        assert page.run(shown) == "Frame 15, 0.50 s, held out"
        page.run(
            "(() => { const c = document.querySelectorAll('#where .canvas')[1];"
            "c.scrollIntoView(); const box = c.querySelector('image').getBoundingClientRect();"
            "c.dispatchEvent(new MouseEvent('click', { clientX: box.left + 0.5 * box.width / 9,"
            "clientY: box.top + box.height / 2 })); })()"
        )
        assert page.run(shown) == "Frame 10, 0.00 s"
        ground = []
        for width, dark in ((1200, False), (390, False), (390, True)):
            page.show(width, 844, dark)
            assert page.run("document.documentElement.scrollWidth") <= width
            cut = "[...document.querySelectorAll('table')].filter(t => t.scrollWidth > innerWidth)"
            assert page.run(f"{cut}.length") == 0
            assert page.run(OVERLAPPING) == []
            ground.append(page.run("getComputedStyle(document.body).backgroundColor"))
        assert ground == ["rgb(255, 255, 255)", "rgb(255, 255, 255)", "rgb(20, 23, 27)"]
        assert page.requested() == [path.as_uri()]
        assert not page.complaints()
        assert page.sheets() == 2


# Pairs of texts of one figure, and of parts of the page, that cover each other.
OVERLAPPING = """
(() => {
  const found = [], cover = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2
    && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 3;
  const groups = [[...document.querySelectorAll('h1, h2, main p, figure, .control, table, li')]
    .filter(e => !e.querySelector('figure, p, li') && !e.closest('figure figure'))];
  for (const svg of document.querySelectorAll('.canvas > svg'))
    groups.push([...svg.querySelectorAll('text')]);
  for (const group of groups) {
    const boxes = group.map(e => [e, e.getBoundingClientRect()]).filter(([e, b]) => b.width);
    boxes.forEach(([one, a], i) => boxes.slice(i + 1).forEach(([other, b]) => {
      if (!one.contains(other) && cover(a, b))
        found.push([one.textContent.slice(0, 40), other.textContent.slice(0, 40)]);
    }));
  }
  return found;
})()
"""
