"""How a diagnosis is stated where the rope's mass is not known: shapes tell ratios to it only."""

from __future__ import annotations

import re
from typing import Any

from ropefit.artifacts.causes import Cause, Size
from ropefit.artifacts.diagnosis import Detectable

GOES_WITH_MASS = re.compile(r"\b(kg|N)\b")
RELATIVE = "per kg/m of the rope"


def per_unit_mass(content: dict[str, Any]) -> dict[str, Any]:
    """Return the fields of diagnosis.h5 whose masses and forces are those of a rope of 1 kg/m, with
    units that say so."""
    causes = {key: _cause(cause) for key, cause in content["causes"].items()}
    detectable = {key: _stated(size) for key, size in content["detectable"].items()}
    return content | {"causes": causes, "detectable": detectable}


def _cause(cause: Cause) -> Cause:
    sizes = {name: _stated(size) for name, size in cause.parameters.items()}
    if sizes == cause.parameters:
        return cause
    sentence = f"{cause.sentence} (of a rope of 1 kg/m: its mass is not known)"
    law = cause.law
    if law:
        stated = {name: _stated(size) for name, size in law.parameters.items()}
        law = law.model_copy(update={"parameters": stated})
    return cause.model_copy(update={"parameters": sizes, "sentence": sentence, "law": law})


def _stated(size: Size | Detectable) -> Size | Detectable:
    if not GOES_WITH_MASS.search(size.unit):
        return size
    stated = {"unit": f"{size.unit} {RELATIVE}"}
    if isinstance(size, Detectable):  # its sentence is of a known mass
        stated |= {"topic": "", "sentence": ""}
    return size.model_copy(update=stated)
