"""What every artifact is made of: pydantic models whose arrays know their dimensions and unit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, get_args

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator
from pydantic_core import core_schema

# Dimensions whose size never changes; all others take their size from the data.
FIXED_SIZES = {"xyz": 3, "wxyz": 4, "uv": 2, "end": 2, "row": 4, "column": 4}


@dataclass(frozen=True)
class ArraySpec:
    """Annotation of a numpy field: names of its dimensions, SI unit, dtype, and whether NaN may
    occur.

    Use as ``Annotated[np.ndarray, ArraySpec(("frame", "xyz"), "m")]``.
    """

    dims: tuple[str, ...]
    unit: str = "1"
    dtype: str = "float64"
    nan: bool = False

    def validate(self, value: Any) -> np.ndarray:
        array = np.asarray(value)
        if array.dtype.kind not in "biuf":
            raise ValueError(f"expected numbers of type {self.dtype}, got {array.dtype}")
        if array.dtype.kind == "f" and np.dtype(self.dtype).kind in "biu":
            raise ValueError(f"expected {self.dtype}, got {array.dtype}")
        array = np.asarray(array, dtype=self.dtype, order="C")
        if array.ndim != len(self.dims):
            raise ValueError(f"expected dimensions {self.dims}, got shape {array.shape}")
        for name, size in zip(self.dims, array.shape, strict=True):
            if FIXED_SIZES.get(name, size) != size:
                raise ValueError(f"dimension {name} has size {size}, not {FIXED_SIZES[name]}")
        if array.dtype.kind == "f":
            finite = ~np.isinf(array) if self.nan else np.isfinite(array)
            if not finite.all():
                raise ValueError("infinite entries" if self.nan else "NaN or infinite entries")
        array.setflags(write=False)
        return array

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.no_info_plain_validator_function(self.validate)

    def __get_pydantic_json_schema__(self, schema: Any, handler: Any) -> dict[str, Any]:
        return {
            "type": "array",
            "x-hdf5": "dataset",
            "dims": list(self.dims),
            "unit": self.unit,
            "dtype": self.dtype,
            "nan": self.nan,
        }


def array_spec(annotation: Any, metadata: tuple[Any, ...] | list[Any] = ()) -> ArraySpec | None:
    """Return the ArraySpec of a field's annotation (also inside ``… | None``), or None if it is no
    array."""
    for item in metadata:
        if isinstance(item, ArraySpec):
            return item
    for item in get_args(annotation):
        if isinstance(item, ArraySpec):
            return item
        found = array_spec(item) if get_args(item) else None
        if found:
            return found
    return None


def quantity(unit: str, description: str = "", **kwargs: Any) -> Any:
    """Return a pydantic field for a scalar with an SI unit, kept in the schema and in the HDF5
    file."""
    return Field(description=description, json_schema_extra={"unit": unit}, **kwargs)


class Part(BaseModel):
    """A group inside an artifact: unknown keys are errors, dimensions of equal name agree in
    size."""

    model_config = ConfigDict(
        extra="forbid",
        arbitrary_types_allowed=True,
        frozen=True,
        defer_build=True,  # a validator is built when it is used; all of them take 0.1 s
    )

    @model_validator(mode="after")
    def _dimensions_agree(self) -> Part:
        sizes: dict[str, tuple[int, str]] = {}
        for name, field in type(self).model_fields.items():
            spec = array_spec(field.annotation, field.metadata)
            value = getattr(self, name)
            if spec is None or value is None:
                continue
            for dim, size in zip(spec.dims, value.shape, strict=True):
                known, owner = sizes.setdefault(dim, (size, name))
                if known != size:
                    raise ValueError(f"dimension {dim} is {size} in {name} but {known} in {owner}")
        return self


class Provenance(Part):
    """Where an artifact comes from. Inputs and settings decide whether it is up to date."""

    stage: str
    package_version: str
    code_sha256: str = Field(default="", description="of the package's own source")
    inputs: dict[str, str] = Field(default_factory=dict, description="name of input -> sha256")
    settings: dict[str, Any] = Field(default_factory=dict)
    settings_sha256: str = ""
    created: str = Field(default="", description="UTC, ISO 8601; not part of the content hash")
    seconds: float = quantity("s", "time the stage took; not part of the content hash", default=0.0)


class Artifact(Part):
    """A file in a run directory, written by one stage and read by others."""

    schema_name: ClassVar[str]
    schema_version: ClassVar[int] = 1
    file_name: ClassVar[str]
    compressed: ClassVar[bool] = True
    provenance: Provenance
