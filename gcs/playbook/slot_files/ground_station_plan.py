"""Slots in a plan of QGroundControl (.plan): its waypoints in their order, or else the corners of its one polygon."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from gcs.playbook.slot_files.slots import FoundSlot, Problem, SlotFileError, on_globe, read_text

_NAV_WAYPOINT, _NAV_SPLINE_WAYPOINT = 16, 82
_GLOBAL_FRAMES: Final = (0, 3, 5, 6, 10, 11)
"""Those of MAVLink in which a waypoint has a latitude and a longitude."""


def read_plan(path: Path) -> list[FoundSlot]:
    """Return the slots of a plan; SlotFileError when it is none, or holds neither waypoints nor just one polygon."""
    text = read_text(path)
    try:
        plan = json.loads(text)
    except json.JSONDecodeError as error:
        raise SlotFileError(path, [Problem(error.lineno, f"is no plan: {error.msg}")]) from error
    except (ValueError, RecursionError) as error:
        raise SlotFileError(path, [Problem(1, f"is no plan: {error}")]) from error
    try:
        if not isinstance(plan, dict) or plan.get("fileType") != "Plan":
            raise ValueError("is no plan of QGroundControl: it has no fileType 'Plan'")
        waypoints = list(_waypoints(plan))
        return waypoints or _corners(_polygons(plan))
    except (KeyError, TypeError, IndexError, AttributeError) as error:
        raise SlotFileError(path, [Problem(1, f"is not formed like a plan of QGroundControl: {error!r}")]) from error
    except ValueError as error:
        raise SlotFileError(path, [Problem(1, str(error))]) from error


def _waypoints(plan: dict[str, Any]) -> Iterator[FoundSlot]:
    for count, item in enumerate(plan["mission"]["items"], start=1):
        if item.get("type") != "SimpleItem" or item["command"] not in (_NAV_WAYPOINT, _NAV_SPLINE_WAYPOINT):
            continue
        if item["frame"] not in _GLOBAL_FRAMES:
            raise ValueError(f"item {count} is in frame {item['frame']}: a slot needs a latitude and a longitude")
        try:
            yield on_globe(1, None, item["params"][4], item["params"][5])
        except ValueError as error:
            raise ValueError(f"item {count}: {error}") from error


def _polygons(plan: dict[str, Any]) -> Iterator[list[Any]]:
    """Yield the polygons of surveys and structures, then those of the fence."""
    for item in plan["mission"]["items"]:
        if item.get("type") == "ComplexItem" and "polygon" in item:
            yield item["polygon"]
    for fence in plan.get("geoFence", {}).get("polygons", ()):
        yield fence["polygon"]


def _corners(polygons: Iterator[list[Any]]) -> list[FoundSlot]:
    found = list(polygons)
    if len(found) != 1:
        raise ValueError(f"holds no waypoints and {len(found)} polygons: slots are waypoints, or one polygon's corners")
    return [on_globe(1, None, corner[0], corner[1]) for corner in found[0]]
