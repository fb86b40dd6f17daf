"""Frames that a diagnosis does not compare are told, and kept in its artifact."""

import numpy as np

from ropefit.api.summaries import diagnosed
from ropefit.artifacts import Diagnosis, Observations, read
from ropefit.fitting.diagnosed import OUTSIDE, lost_with_effects
from ropefit.reporting.contents import RunContents
from ropefit.reporting.sections.why import WhySection
from ropefit.runs.protocol import Outcome
from tests.conftest import ROOT

FIXTURES = ROOT / "tests" / "fixtures"


def test_frames_that_depend_on_what_was_before_are_told_by_their_numbers():
    mask = np.ones((4, 3), dtype=bool)
    mask[1] = False  # nothing was seen there
    without = mask.copy()
    without[0] = False
    without[3, 1] = False  # another station was matched there
    told: list[str] = []
    numbers = np.array([10, 12, 14, 16])
    found = lost_with_effects(mask, without, numbers, told.append)
    assert [(item.frame, item.reason) for item in found] == [(10, OUTSIDE)]
    assert told == [f"excluded, {OUTSIDE}: frames 10"]
    assert lost_with_effects(mask, mask, numbers, told.append) == []
    assert len(told) == 1


def test_the_summary_and_the_report_name_excluded_frames():
    path = FIXTURES / "diagnosis.v6.h5"
    found, _ = read(path, Diagnosis)
    summary = diagnosed(Outcome(found, path, True, ""))
    assert summary["dropped"] == [{"frame": 7, "reason": "at the edge of stability"}]
    seen, _ = read(FIXTURES / "observations.v5.h5", Observations)
    page = WhySection().render(RunContents(seen, diagnosis=found))
    assert "Excluded, at the edge of stability: frames 7." in page
