"""What labs know of a rope: rigid pieces, their weights, mass per length, markers off the axis."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from ropefit.adapters.priors import noise_of, priors_of
from ropefit.adapters.rope_setup import with_fittings
from ropefit.artifacts import Observations
from ropefit.artifacts.observations import Fitting, SetupPriors
from ropefit.errors import BadInput
from ropefit.models.equilibrium import Equilibrium
from ropefit.models.parameters import PARAMETERS
from ropefit.recordings.manifest import Manifest, read_manifest
from ropefit.runs.loading import load
from tests.concealed import rope
from tests.factories import marker_recording
from tests.test_checkpoints import compute

PIECE = Fitting(arc_length=0.5, length=0.1, mass=0.02)
KNOWN = {"format": "ropefit-recording/1", "name": "known", "markers": {"file": "m.csv"}}


def told(*pieces: Fitting) -> Observations:
    """What `with_fittings` reads of observations."""
    named = {str(k): piece for k, piece in enumerate(pieces)}
    return SimpleNamespace(fittings=named)  # pyright: ignore[reportReturnType]


def turn(setup, low: float, high: float) -> float:
    """The largest angle [rad] between the rope's tangents at two places."""
    q = Equilibrium(setup, []).at(np.empty(0)).seen
    arc = setup.arc
    at = [int(np.abs(arc - place).argmin()) for place in (low, high)]
    along = [q[:, k + 1] - q[:, k] for k in at]
    along = [v / np.linalg.norm(v, axis=1, keepdims=True) for v in along]
    return float(np.arccos(np.clip((along[0] * along[1]).sum(1), -1, 1)).max())


def test_a_rope_is_rigid_inside_a_fitting_whatever_its_own_rigidity():
    free = rope(80, 4)
    fitted = with_fittings(free, told(PIECE))
    assert float(fitted.mass.sum()) == pytest.approx(0.02)
    place = float((fitted.mass * fitted.arc).sum() / fitted.mass.sum())
    assert place == pytest.approx(0.5)
    assert turn(free, 0.46, 0.53) > 0.1
    assert turn(fitted, 0.46, 0.53) < 0.01
    softer = PARAMETERS["EI"].apply(fitted, np.array([1e-4]))
    assert turn(softer, 0.46, 0.53) < 0.02
    point = with_fittings(free, told(Fitting(arc_length=0.25, mass=0.01)))
    assert point.rigid is None
    assert float(point.mass.sum()) == pytest.approx(0.01)


def test_a_recording_says_what_is_known(tmp_path):
    marker_recording(tmp_path / "recording", frames=4)
    path = tmp_path / "recording" / "recording.toml"
    lines = [line for line in path.read_text().splitlines() if not line.startswith("mass")]
    text = "\n".join(lines).replace("[rope]", "[rope]\nmass_per_length = 0.05")
    text = text.replace("[markers]", "[markers]\noffset = 0.006")
    path.write_text(text + "\n[[fittings]]\narc_length = 0.3\nlength = 0.02\nmass = 0.004\n")
    read_manifest(tmp_path / "recording")
    compute(tmp_path / "run", "preprocess")
    o, _ = load(tmp_path / "run", Observations)
    assert o.mass == pytest.approx(0.05 * o.length)
    (piece,) = o.fittings.values()
    assert (piece.arc_length, piece.length, piece.mass) == (0.3, 0.02, 0.004)
    noise = noise_of(o, SimpleNamespace(material=True))  # pyright: ignore[reportArgumentType]
    own = float(np.median(o.noise))
    assert noise.sensor == own
    assert noise.marker == pytest.approx(np.hypot(own, 0.006 / 3**0.5))


@pytest.mark.parametrize(
    ("more", "why"),
    [
        ({"rope": {"mass": 0.1, "mass_per_length": 0.1}}, "not both"),
        ({"fittings": [{"arc_length": 0.1, "mass": 0.01}]}, "needs that of the rope"),
        ({"rope": {"length": 1.0}, "fittings": [{"arc_length": 1.2}]}, "beyond the rope's end"),
        ({"rope": {"length": 1.0}, "fittings": [{"arc_length": -0.2}]}, "greater than or equal"),
    ],
)
def test_what_cannot_be_is_refused(more, why):
    with pytest.raises((ValueError, BadInput), match=why):
        Manifest.model_validate(KNOWN | more)


@pytest.mark.parametrize(("assumed", "expected"), [(False, 0.0015), (True, 0.0065)])
def test_ends_that_are_seen_are_as_uncertain_as_the_length_that_is_seen(assumed, expected):
    o = SimpleNamespace(
        priors=SetupPriors(), end_twist_known=True, ends_assumed=assumed, length_sd=0.006,
        noise=np.full(3, 0.002),
    )  # fmt: skip
    assert priors_of(o).end_position == pytest.approx(expected)  # pyright: ignore[reportArgumentType]
    o.priors = SetupPriors(end_position=0.001)
    assert priors_of(o).end_position == 0.001  # pyright: ignore[reportArgumentType]
