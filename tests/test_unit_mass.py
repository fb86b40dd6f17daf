"""A rope of unknown mass: masses and forces of effects are told as those of a rope of 1 kg/m."""

from dataclasses import astuple

import numpy as np

from ropefit.adapters.rope_description import described
from ropefit.adapters.unit_mass import RELATIVE, per_unit_mass
from ropefit.artifacts.causes import Cause, Size
from ropefit.artifacts.diagnosis import Detectable
from ropefit.attachments import PointMass
from ropefit.effects import Tether
from tests.report_runs import balanced, diagnosed, observations


def cause(name: str, unit: str) -> Cause:
    return Cause(
        name=name, kind="physics", variant="Any", end=None, arc_length=(0.4, 0.5),
        frames=np.array([0]), parameters={"size": Size(value=2.0, unit=unit, ci95=(1.0, 3.0))},
        values=np.array([2.0]), value_names=["size"], equivalent_to=[], log_evidence=9.0,
        p_value=0.01, heldout_gain=np.array([1.0]), sentence="it is so",
    )  # fmt: skip


def test_masses_and_forces_are_relative_and_nothing_else():
    causes = {
        "a": cause("point_mass", "kg"),
        "b": cause("tether", "N/m"),
        "c": cause("kink", "rad"),
    }
    detectable = {
        "point_mass": Detectable(value=0.1, unit="kg", topic="weight", sentence="100 g"),
        "kink": Detectable(value=0.1, unit="rad"),
    }
    out = per_unit_mass({"causes": causes, "detectable": detectable, "verdict": "found"})
    assert [c.parameters["size"].unit for c in out["causes"].values()] == [
        f"kg {RELATIVE}", f"N/m {RELATIVE}", "rad",
    ]  # fmt: skip
    assert "1 kg/m" in out["causes"]["a"].sentence
    assert out["causes"]["c"].sentence == "it is so"
    assert [d.unit for d in out["detectable"].values()] == [f"kg {RELATIVE}", "rad"]
    assert out["detectable"]["point_mass"].sentence == ""  # it would be of a known mass
    assert out["verdict"] == "found"


def test_an_export_weighs_what_was_found_without_the_mass():
    """The rope of a run without a mass, once weighed, is that of the run with it."""
    mass, o = 0.05, observations()
    density = mass / o.length
    ropes = []
    for known in (True, False):
        model, found = balanced(mass_known=known), diagnosed()
        scale = 1.0 if known else density  # of the fit with the mass, over that without
        cause = found.causes["cause_0"]
        found.causes["cause_0"] = cause.model_copy(
            update={"values": np.array([0.0041 / scale, 0.37])}
        )
        found.causes["cause_1"] = cause.model_copy(
            update={
                "name": "tether", "variant": "Tether", "value_names": [*Tether().names],
                "values": np.array([0.2 / scale, 0.01 / scale, 0.0, 0.02 / scale, 0.6]),
            }
        )  # fmt: skip
        group = model.groups["group_0"]
        bend = group.parameters["EI"].model_copy(
            update={"value": 7e-4 / (1.0 if known else density * 9.81)}
        )
        group = group.model_copy(update={"parameters": {"EI": bend}})
        model = model.model_copy(update={"groups": {"group_0": group}})
        ropes.append(described(o, model, found).rope)
    assert np.isclose(ropes[0].EI.mean(), 7e-4)
    assert PointMass in {type(e) for e in ropes[0].effects}
    for a, b in zip(ropes[0].effects, ropes[1].effects, strict=True):
        assert type(a) is type(b)
        for one, other in zip(astuple(a), astuple(b), strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(ropes[0].EI, ropes[1].EI)
    np.testing.assert_allclose(ropes[0].x, ropes[1].x, atol=1e-8)
