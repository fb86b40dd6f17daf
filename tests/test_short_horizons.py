"""Short horizons: where parts of clips begin, and a cause that whole clips are out of step with."""

from __future__ import annotations

import numpy as np
import pytest

from ropefit.diagnosis.hypotheses import hypotheses
from ropefit.diagnosis.short_horizons import by_short_horizons
from ropefit.effects.rest_shape import RestShape
from ropefit.inference.least_squares import fit
from ropefit.inference.noise import Noise
from ropefit.inference.problem import FitProblem
from ropefit.models.first_state import SMOOTHED, begun_smoothly
from tests.test_diagnosis_of_motion import FRAMES, FREE, driven, model, recorded


@pytest.mark.parametrize("place", [0, 17, FRAMES - 3])
def test_parts_begin_on_the_parabola_of_their_clip(place):
    time = np.arange(FRAMES) * 0.01
    powers = np.vander(time, 3)
    true = (powers @ np.array([[-4.0], [1.0], [0.2]]))[:, :, None] * np.ones((1, 5, 3))
    seen = true.copy()
    seen[place] += 0.01  # an error of one frame is averaged
    clip = np.arange(FRAMES)
    out = begun_smoothly(time, seen, [clip], [clip[place:]])
    others = np.delete(clip, [place, place + 1])
    assert (out[others] == seen[others]).all()
    assert np.abs(out[place] - true[place]).max() < 0.007
    exact = begun_smoothly(time, true, [clip], [clip[place:]])
    assert exact == pytest.approx(true, abs=1e-9)


def test_a_horizon_begins_anew_from_what_was_observed():
    lines, _ = recorded(None, [], seed=0)
    forward = model(driven(24), lines, FREE)
    parts = forward.horizon(0.3)
    assert [len(part) for part in parts.clips] == [30] * 6
    assert (np.concatenate(parts.clips) == np.concatenate(forward.clips)).all()
    assert len(forward.horizon(0.01).clips[0]) >= SMOOTHED
    lines[30] = np.nan  # where nothing was seen, nothing begins
    assert [len(part) for part in model(driven(24), lines, FREE).horizon(0.3).clips] == [30] * 5
    wrong = forward.start() + np.array([2.0, *np.zeros(forward.size - 1)])
    missed = [
        np.abs(one.at(wrong).seen[:, ::2] - lines)[31:].max(
            initial=0.0, where=~np.isnan(lines)[31:]
        )
        for one in (forward, parts)
    ]
    assert missed[1] < missed[0]


def test_a_rest_curve_is_found_over_short_horizons_and_fitted_to_whole_clips():
    curve = [6.0, 4.0, -2.0, -5.0, -3.0, 0.0, 3.0, 5.0, 2.0, -4.0]
    lines, data = recorded(RestShape(), curve, seed=5)
    forward = model(driven(24), lines, FREE)
    nominal = fit(forward, FitProblem(data, Noise(marker=0.002), 40), None, 15, tolerance=1e-4)
    tried = [h for h in hypotheses(nominal.point.setup) if h.name in ("rest_curve", "weight_error")]
    found = by_short_horizons(nominal, tried, 6.0)
    assert found[0].hypothesis.name == "rest_curve"
    before, after = (np.sqrt((f.stations.residual**2).mean()) for f in (nominal, found[0].fit))
    assert after < 0.5 * before
    # The first speed is as noisy as two frames, and the mesh is half as fine as the rope's.
    assert np.corrcoef(found[0].values(), curve)[0, 1] > 0.9
