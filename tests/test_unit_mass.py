"""A rope of unknown mass: masses and forces of effects are told as those of a rope of 1 kg/m."""

import numpy as np

from ropefit.adapters.unit_mass import RELATIVE, per_unit_mass
from ropefit.artifacts.causes import Cause, Size
from ropefit.artifacts.diagnosis import Detectable


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
