"""The pages that tell people what to type: the tutorial is followed, every option is described."""

from __future__ import annotations

import importlib.util
import re
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from benchmarks.document import write_section
from benchmarks.robustness.commands import page
from ropefit.cli import app
from tests.conftest import ROOT, SAMPLES
from tests.sources import CAMERA, Ros

DOCS = ROOT / "docs"
FRAMES = range(0, 36, 3)


def your_bag(path: Path) -> None:
    """What the tutorial says you have: the sample's clouds, seen by a camera, as a ROS 1 bag."""
    from ropefit.recordings import open_recording

    recording = open_recording(SAMPLES / "cloud")
    assert recording.ends is not None
    ros = Ros(1)
    messages: list[tuple[str, float, object]] = [
        ("/tf_static", 100.0, ros.tree(ros.tf(100.0, "world", "camera", *CAMERA)))
    ]
    for frame in FRAMES:
        time = 100.0 + 0.1 * frame
        seen = recording.source.sight(frame).points
        assert seen is not None
        seen = seen - CAMERA[0]
        inside = np.stack([seen[:, 0], -seen[:, 2], seen[:, 1]], axis=1)
        ends = [end.position[frame] for end in recording.ends]
        messages += [
            ("/camera/points", time, ros.cloud(time, inside, "camera")),
            ("/tf", time, ros.tree(ros.tf(time, "world", "gripper_link", ends[0]))),
            ("/mocap/clamp", time, ros.pose(time, ends[1])),
        ]
    ros.write(path, messages)


def test_the_tutorial_followed_literally(ropefit, tmp_path):
    pytest.importorskip("rerun")
    pytest.importorskip("mujoco")
    your_bag(tmp_path / "run3.bag")
    blocks = re.findall(r"```(\w*)\n(.*?)```", (DOCS / "tutorial.md").read_text(), re.DOTALL)
    commands = [line for kind, text in blocks if not kind for line in text.strip().splitlines()]
    assert len(commands) == 9
    said = ""
    for command in commands:
        words = shlex.split(command)
        assert words[0] == "ropefit"
        done = ropefit(*words[1:])
        said += done.stdout + done.stderr
    assert "/camera/points" in said
    assert "determined" in said
    assert "At rest in mujoco 4" in (tmp_path / "out" / "report.html").read_text()
    assert (tmp_path / "out" / "report.html").stat().st_size < 1e6
    assert (tmp_path / "out" / "view.rrd").read_bytes()[:3] == b"RRF"
    (code,) = [text for kind, text in blocks if kind == "python"]
    shown = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True
    )
    assert shown.returncode == 0, shown.stderr
    first = np.array([float(v) for v in re.findall(r"-?\d+\.\d+(?:e-?\d+)?", shown.stdout)[:3]])
    ends = np.loadtxt(tmp_path / "run3" / "ends.csv", delimiter=",", skiprows=1)
    start = ends[(ends[:, 0] == 0) & (ends[:, 2] == 0)][0, 3:6]
    np.testing.assert_allclose(first, start, atol=0.02)


def commands() -> list[str]:
    import typer.main

    return list(typer.main.get_command(app).commands)  # type: ignore[attr-defined]


def test_every_option_is_described():
    """docs/commands.md is the command line's own; every option has a sentence."""
    assert (DOCS / "commands.md").read_text() == page(), (
        "run python -m benchmarks.robustness.commands --write docs/commands.md"
    )
    assert "None |" not in page()
    for command in commands():
        assert f"## `{command}`" in page()


def test_the_readme_shows_commands_that_exist():
    text = (ROOT / "README.md").read_text()
    typed = "\n".join(re.findall(r"```\n(.*?)```", text, re.DOTALL))
    shown = re.findall(r"^(?:\.venv/bin/)?ropefit (\w+)", typed, re.MULTILINE)
    assert shown
    assert set(shown) <= set(commands())
    for link in re.findall(r"\]\(((?:docs|examples|sample_data)/[^)#]+)\)", text):
        assert (ROOT / link).exists(), link


def test_the_benchmarks_that_are_named_exist():
    """Every `python -m benchmarks...` in documents, Makefile, pipelines and CI is a module."""
    pages = [ROOT / "README.md", ROOT / "Makefile", ROOT / ".ci" / "run", *DOCS.glob("*.md")]
    pages += sorted((ROOT / "pipelines").glob("*.mk"))
    named = {
        (file.name, module)
        for file in pages
        for module in re.findall(r"-m (benchmarks[\w.]*\w)", file.read_text())
    }
    assert len(named) > 20
    for where, module in sorted(named):
        found = importlib.util.find_spec(module)
        assert found is not None, f"{where} names {module}"
        if found.submodule_search_locations:
            assert importlib.util.find_spec(f"{module}.__main__"), f"{where} names {module}"


@pytest.mark.parametrize(("page", "fewest"), [("results", 10), ("real", 4), ("robustness", 2)])
def test_every_section_of_the_results_has_its_command(page, fewest):
    text = (DOCS / f"{page}.md").read_text()
    sections = re.findall(r"<!-- begin ([\w-]+) -->\n(.*?)<!-- end \1 -->", text, re.DOTALL)
    assert len(sections) == text.count("<!-- begin") == text.count("<!-- end") > fewest
    for name, section in sections:
        assert "`python -m benchmarks." in section, name
    assert len(text.splitlines()) <= 400


def test_a_section_is_replaced_and_nothing_else(tmp_path):
    found = tmp_path / "page.md"
    found.write_text("# Page\n\n<!-- begin it -->\nold\n<!-- end it -->\n\n## Next\n")
    for _ in range(2):
        write_section(found, "it", "new\n")
        assert found.read_text() == (
            "# Page\n\n<!-- begin it -->\nnew\n<!-- end it -->\n\n## Next\n"
        )
