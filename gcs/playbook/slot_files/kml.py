"""Slots in a map (KML): its placemarks' points in their order, or else the corners of its one line or polygon.

A document type is refused before anything in it is read: no entity is ever expanded, nothing outside is ever fetched.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final
from xml.parsers import expat

from gcs.playbook.slot_files.slots import FoundSlot, Problem, SlotFileError, on_globe, read_text

_SHAPES: Final = ("Point", "LineString", "LinearRing")
_HOLE: Final = "innerBoundaryIs"


def read_kml(path: Path) -> list[FoundSlot]:
    """Return the slots of a map; SlotFileError when it is none, or holds neither points nor one line or polygon."""
    text = read_text(path)
    drawing = _Drawing()
    parser = expat.ParserCreate()
    parser.buffer_text = True
    parser.StartDoctypeDeclHandler = _refuse_document_type
    parser.StartElementHandler = lambda name, _: drawing.begin(_local(name), parser.CurrentLineNumber)
    parser.EndElementHandler = lambda name: drawing.end(_local(name))
    parser.CharacterDataHandler = drawing.text.append
    try:
        parser.Parse(text, True)  # noqa: FBT003 - it takes nothing by name
    except expat.ExpatError as error:
        raise SlotFileError(path, [Problem(error.lineno, f"is no KML: {expat.ErrorString(error.code)}")]) from error
    except ValueError as error:
        raise SlotFileError(path, [Problem(parser.CurrentLineNumber, str(error))]) from error
    return _chosen(path, drawing)


def _refuse_document_type(name: str, *_: object) -> None:
    raise ValueError(f"has a document type ({name}): KML needs none, and none is read")


def _local(name: str) -> str:
    return name.rpartition(":")[2]


@dataclass
class _Drawing:
    """What is drawn in a map, gathered while it is parsed."""

    points: list[FoundSlot] = field(default_factory=list)
    outlines: list[list[FoundSlot]] = field(default_factory=list)
    problems: list[Problem] = field(default_factory=list)
    text: list[str] = field(default_factory=list)
    _path: list[str] = field(default_factory=list)
    _line: int = 1
    _name: str | None = None
    _named: int = 0
    """How many points there were when the placemark began."""

    def begin(self, name: str, line: int) -> None:
        self._path.append(name)
        self._line = line
        self.text.clear()
        if name == "Placemark":
            self._name, self._named = None, len(self.points)

    def end(self, name: str) -> None:
        written = "".join(self.text)
        self._path.pop()
        parent = self._path[-1] if self._path else ""
        if name == "name" and parent == "Placemark":
            self._name = written.strip() or None
        elif name == "coordinates" and parent in _SHAPES and _HOLE not in self._path:
            self._take(parent, written)
        elif name == "Placemark" and len(self.points) == self._named + 1:
            at = self.points[-1]
            self.points[-1] = FoundSlot(at.line, self._name, at.place)
        self.text.clear()

    def _take(self, shape: str, written: str) -> None:
        corners: list[FoundSlot] = []
        for line, text in enumerate(written.split("\n"), start=self._line):
            for place in text.split():
                try:
                    corners.append(on_globe(line, None, *_longitude_last(place)))
                except ValueError as error:
                    self.problems.append(Problem(line, str(error)))
        if shape == "Point":
            self.points += corners
        else:
            closed = len(corners) > 1 and corners[0].place == corners[-1].place
            self.outlines.append(corners[:-1] if closed else corners)


def _longitude_last(place: str) -> tuple[str, str]:
    """Return latitude and longitude of a place that KML writes the other way round, with or without an altitude."""
    parts = place.split(",")
    if len(parts) not in (2, 3):
        raise ValueError(f"{place!r} is not longitude,latitude or longitude,latitude,altitude")
    return parts[1], parts[0]


def _chosen(path: Path, drawing: _Drawing) -> list[FoundSlot]:
    if drawing.problems:
        raise SlotFileError(path, drawing.problems)
    if drawing.points:
        return drawing.points
    if len(drawing.outlines) != 1:
        count = len(drawing.outlines)
        problem = f"holds no points and {count} lines and polygons: slots are points, or the corners of one of those"
        raise SlotFileError(path, [Problem(1, problem)])
    return drawing.outlines[0]
