"""The formation section of a playbook: one class for each kind."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, PrivateAttr, ValidationInfo, model_serializer, model_validator

from gcs.playbook.sections import Degrees, Metres, Name, Point, Section
from gcs.playbook.slot_files.ground_station_plan import read_plan
from gcs.playbook.slot_files.kml import read_kml
from gcs.playbook.slot_files.slots import FoundSlot, Surroundings, placed
from gcs.playbook.slot_files.table import read_table
from planner import formations
from planner.formations import Slots


class _Formation(Section):
    scale: Annotated[float, Field(gt=0.0, le=1000.0)] = 1.0
    rotation_deg: Degrees = 0.0
    mirrored: bool = False

    def points(self) -> Slots:
        """Return the slots by name, in relay order, formation frame, m."""
        return formations.transformed(
            self._drawn(), scale=self.scale, rotation_rad=math.radians(self.rotation_deg), mirrored=self.mirrored
        )

    def _drawn(self) -> Slots:
        raise NotImplementedError


class _Counted(_Formation):
    slots: Annotated[int, Field(ge=1, le=10_000)]


class Circle(_Counted):
    """Slots O1.. on the circle about L0, 360/(slots + 1) degrees apart."""

    kind: Literal["circle"]
    radius_m: Metres

    def _drawn(self) -> Slots:
        return formations.circle(self.slots, self.radius_m)


class Polygon(_Counted):
    """Slots evenly along a regular polygon about L0, L1 in its first corner."""

    kind: Literal["polygon"]
    radius_m: Metres
    sides: Annotated[int, Field(ge=3, le=100)] = 6

    def _drawn(self) -> Slots:
        return formations.polygon(self.slots, self.radius_m, self.sides)


class Line(_Counted):
    """Slots in a line from L0, by default across the axis."""

    kind: Literal["line"]
    spacing_m: Metres
    direction_deg: Degrees = 90.0

    def _drawn(self) -> Slots:
        return formations.line(self.slots, self.spacing_m, math.radians(self.direction_deg))


class Echelon(_Counted):
    """Slots behind L0 on its left."""

    kind: Literal["echelon"]
    spacing_m: Metres
    sweep_deg: Degrees = 45.0

    def _drawn(self) -> Slots:
        return formations.echelon(self.slots, self.spacing_m, math.radians(self.sweep_deg))


class Vee(_Counted):
    """Slots on two wings behind L0."""

    kind: Literal["vee"]
    spacing_m: Metres
    sweep_deg: Degrees = 45.0

    def _drawn(self) -> Slots:
        return formations.vee(self.slots, self.spacing_m, math.radians(self.sweep_deg))


class Grid(_Counted):
    """Slots in rows parallel to the axis."""

    kind: Literal["grid"]
    spacing_m: Metres
    columns: Annotated[int, Field(ge=1, le=1000)] | None = None

    def _drawn(self) -> Slots:
        return formations.grid(self.slots, self.spacing_m, self.columns)


class Custom(_Formation):
    """Slots wherever they are written, in relay order."""

    kind: Literal["custom"]
    slots: Annotated[dict[Name, Point], Field(min_length=1)]

    def _drawn(self) -> Slots:
        return formations.custom(self.slots)


class _FromFile(_Formation):
    """Slots from a file named from the playbook's folder; read once, with the playbook, and written out as `custom`."""

    file: Annotated[str, Field(min_length=1)]
    _slots: Slots = PrivateAttr(default_factory=dict)

    @model_validator(mode="after")
    def _read(self, info: ValidationInfo) -> _FromFile:
        if not isinstance(info.context, Surroundings):
            raise ValueError("slots from a file are read with the playbook's own file, from its folder")
        path = info.context.folder / self.file
        self._slots = placed(path, self._found(path), info.context)
        return self

    @model_serializer
    def _written_out(self) -> dict[str, Any]:
        slots = {name: [point.real, point.imag] for name, point in self._slots.items()}
        drawn = {"scale": self.scale, "rotation_deg": self.rotation_deg, "mirrored": self.mirrored}
        return {"kind": "custom", "slots": slots, **drawn}

    def _found(self, path: Path) -> list[FoundSlot]:
        raise NotImplementedError

    def _drawn(self) -> Slots:
        return formations.custom(self._slots)


class Table(_FromFile):
    """Slots in a table: columns x, y in metres or lat, lon in degrees, and name; in relay order."""

    kind: Literal["csv"]

    def _found(self, path: Path) -> list[FoundSlot]:
        return read_table(path)


class GroundStationPlan(_FromFile):
    """Slots in a plan of QGroundControl: its waypoints, or the corners of its one polygon."""

    kind: Literal["plan"]

    def _found(self, path: Path) -> list[FoundSlot]:
        return read_plan(path)


class Map(_FromFile):
    """Slots in a KML map: its points, or the corners of its one line or polygon."""

    kind: Literal["kml"]

    def _found(self, path: Path) -> list[FoundSlot]:
        return read_kml(path)


Formation = Annotated[
    Circle | Polygon | Line | Echelon | Vee | Grid | Custom | Table | GroundStationPlan | Map,
    Field(discriminator="kind"),
]
KINDS = ("circle", "polygon", "line", "echelon", "vee", "grid", "custom", "csv", "plan", "kml")
