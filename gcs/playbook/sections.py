"""What every section of a playbook is made of: strictness, names, points, lengths."""

from __future__ import annotations

import cmath
import math
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    PlainSerializer,
    StringConstraints,
    WithJsonSchema,
)

from drivers.bus.keys import NAME_PATTERN

_FARTHEST_M = 100_000.0


class Section(BaseModel):
    """A part of a playbook: nothing is guessed, nothing unknown is let through, nothing changes afterwards."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def _read_point(value: Any) -> complex:
    if isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)):
        return complex(*value)
    if isinstance(value, dict) and value.keys() == {"radius_m", "angle_deg"} and all(map(_is_number, value.values())):
        return cmath.rect(value["radius_m"], math.radians(value["angle_deg"]))
    raise ValueError("a point is [x, y] in metres, or {radius_m: ..., angle_deg: ...}, within 100 km")


def _write_point(point: complex) -> list[float]:
    return [point.real, point.imag]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= _FARTHEST_M


Name = Annotated[str, StringConstraints(pattern=f"^{NAME_PATTERN}$", max_length=64)]
Point = Annotated[
    complex,
    BeforeValidator(_read_point),
    PlainSerializer(_write_point, when_used="json"),
    WithJsonSchema(
        {
            "description": "[x, y] in metres, or {radius_m: ..., angle_deg: ...}; formation frame",
            "anyOf": [
                {"type": "array", "items": {"type": "number"}, "minItems": 2, "maxItems": 2},
                {
                    "type": "object",
                    "properties": {"radius_m": {"type": "number"}, "angle_deg": {"type": "number"}},
                    "required": ["radius_m", "angle_deg"],
                    "additionalProperties": False,
                },
            ],
        }
    ),
]
Metres = Annotated[float, Field(gt=0.0, le=_FARTHEST_M)]
Degrees = Annotated[float, Field(ge=-360.0, le=360.0)]
