"""Slots as a file gives them, on the plane or on the globe, and what can be wrong with the file."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from drivers.bus.keys import NAME_PATTERN
from planner.formations import Slots, slot_name
from planner.frames import FormationFrame, GeodeticPosition, SiteFrame

FARTHEST_M: Final = 100_000.0
MOST_SLOTS: Final = 10_000
_LARGEST_FILE_BYTES: Final = 4_000_000
_LONGEST_NAME: Final = 64
_HUGE: Final = 1e300


@dataclass(frozen=True)
class Problem:
    """Something wrong, and its line, counted from 1."""

    line: int
    message: str


class SlotFileError(ValueError):
    """A file of slots cannot be used; `problems` is what is wrong with it."""

    def __init__(self, path: Path, problems: Sequence[Problem]) -> None:
        self.path = path
        self.problems = tuple(problems)
        super().__init__("\n".join(f"{path}:{problem.line}: {problem.message}" for problem in problems))


@dataclass(frozen=True)
class FoundSlot:
    """A slot as it stands in a file: formation frame, m, or on the globe (its altitude does not matter)."""

    line: int
    name: str | None
    place: complex | GeodeticPosition


@dataclass(frozen=True)
class Surroundings:
    """Where a playbook stands: its folder, and the site its formation is tied to; None when that is not right."""

    folder: Path
    site: tuple[GeodeticPosition, FormationFrame] | None


def read_text(path: Path) -> str:
    """Return the text of a file, without a byte order mark.

    ValueError when there is no such file to read, SlotFileError when it is too large or no text.
    """
    try:
        if path.stat().st_size > _LARGEST_FILE_BYTES:
            raise SlotFileError(path, [Problem(1, "is too large for a file of slots (over 4 MB)")])
        return path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise ValueError(f"{path} cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise SlotFileError(path, [Problem(1, f"is no text: {error}")]) from error


def on_globe(line: int, name: str | None, latitude: str | float, longitude: str | float) -> FoundSlot:
    """Return a slot at a latitude and longitude, degrees; ValueError when they are none."""
    latitude_deg, longitude_deg = number(latitude), number(longitude)
    if not (-90.0 <= latitude_deg <= 90.0 and -180.0 <= longitude_deg <= 180.0):
        raise ValueError(f"there is no latitude {latitude_deg:g}°, longitude {longitude_deg:g}°")
    return FoundSlot(line, name, GeodeticPosition(latitude_deg, longitude_deg, 0.0))


def number(value: object) -> float:
    """Return a finite number, written out or not; ValueError when it is none."""
    text = value.strip() if isinstance(value, str) else value
    if isinstance(text, str) and re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", text, re.ASCII):
        text = float(text)
    if isinstance(text, bool) or not isinstance(text, int | float) or not abs(text) < _HUGE:
        raise ValueError(f"{value!r:.40} is no number")
    return float(text)


def placed(path: Path, found: Sequence[FoundSlot], around: Surroundings) -> Slots:
    """Return the slots by name, formation frame, m; those without a name are called O1, O2, ... by their place in line.

    SlotFileError when there is none, or one cannot be where or be called as it is.
    """
    slots: Slots = {}
    problems = [] if found else [Problem(1, "holds no slots")]
    if len(found) > MOST_SLOTS:
        problems.append(Problem(found[MOST_SLOTS].line, f"holds more than {MOST_SLOTS} slots"))
    for count, slot in enumerate(found[:MOST_SLOTS], start=1):
        name = slot.name or slot_name(count)
        try:
            _require_name(name, slots)
            slots[name] = _on_plane(slot.place, around)
        except ValueError as error:
            problems.append(Problem(slot.line, f"slot {name}: {error}"))
    if problems:
        raise SlotFileError(path, problems)
    return slots


def _require_name(name: str, slots: Slots) -> None:
    if not re.fullmatch(NAME_PATTERN, name) or len(name) > _LONGEST_NAME:
        raise ValueError(f"a name is of letters, digits, '_', '.' and '-', at most {_LONGEST_NAME} of them")
    if name in slots:
        raise ValueError("there is another of this name")


def _on_plane(place: complex | GeodeticPosition, around: Surroundings) -> complex:
    if isinstance(place, GeodeticPosition):
        if around.site is None:
            raise ValueError("its place follows from the playbook's site, which is not right")
        origin, frame = around.site
        level = GeodeticPosition(place.latitude_deg, place.longitude_deg, origin.altitude_m)
        place = frame.from_site(SiteFrame(origin).from_geodetic(level)[0])
    if abs(place) > FARTHEST_M:
        raise ValueError(f"it lies {abs(place) / 1000.0:.0f} km from L0: check it, and the playbook's site")
    return place
