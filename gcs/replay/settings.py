"""The settings of the stop monitor that a replay can change, by name: `monitor.slot.band_m`."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields, replace
from difflib import get_close_matches
from types import MappingProxyType
from typing import Any, Final

import msgspec

from gcs.errors import ServiceError
from gcs.relay.response import Agility
from gcs.relay.unrest import Unrest
from gcs.stop_monitor import SLOT, TURN, ArrivalRule
from gcs.traced_monitor import SetUp

_GROUPS: Final[Mapping[str, Any]] = MappingProxyType(
    {"turn": TURN, "slot": SLOT, "agility": Agility(), "unrest": Unrest()}
)
"""The rules of legs that end in a turning point, and of those that end in the slot; what vehicles are taken to do."""

NAMES: Final = tuple(
    f"monitor.{group}.{field.name}"
    for group, values in _GROUPS.items()
    for field in fields(values)
    if isinstance(getattr(values, field.name), float)
)

Changes = Mapping[str, float]
"""New values by name."""


def read_changes(settings: Iterable[str]) -> Changes:
    """Return what NAME=VALUE says; ServiceError naming the nearest name, or what is allowed."""
    return dict(_read(setting) for setting in settings)


def changed(made: SetUp, changes: Changes) -> SetUp:
    """Return a monitor's make with what is changed in it."""
    groups = {"rule": kind_of(made.rule), "agility": "agility", "unrest": "unrest"}
    return msgspec.structs.replace(
        made, **{part: replace(getattr(made, part), **_of(group, changes)) for part, group in groups.items()}
    )


def kind_of(rule: ArrivalRule) -> str:
    """Return whose rule it is: only one that ends in its slot has to be on its line."""
    return "slot" if rule.on_line else "turn"


def _of(group: str, changes: Changes) -> dict[str, Any]:
    prefix = f"monitor.{group}."
    return {name.removeprefix(prefix): value for name, value in changes.items() if name.startswith(prefix)}


def _read(setting: str) -> tuple[str, float]:
    name, _, text = setting.partition("=")
    if name not in NAMES:
        (near,) = get_close_matches(name, NAMES, n=1, cutoff=0.0)
        raise ServiceError(f"--set {setting}: there is no {name}; did you mean {near}? replay --help names them all")
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise ServiceError(f"--set {setting}: {name} takes a number above 0, as in --set {name}=0.5")
    return name, value
