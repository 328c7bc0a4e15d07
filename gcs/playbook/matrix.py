"""The `matrix` of a playbook: the same run again with other values, one run for each combination of them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

from gcs.playbook.schema import Playbook
from gcs.playbook.suggestions import Location, Problem

MOST_RUNS: Final = 200
FIXED: Final = ("playbook", "name", "slow", "stages", "expect", "matrix")
"""What stays the same in all runs of a playbook."""

Values = Mapping[str, Any]
"""What a run changes: a path of keys with dots between them, as "sensor.sigma_deg", and the value that stands there."""


@dataclass(frozen=True)
class MatrixRun:
    """One run of a playbook: what it changes, and the playbook as it is flown, without a matrix."""

    values: Values
    playbook: Playbook

    @property
    def label(self) -> str:
        """What it changes, in words; empty when there is nothing to tell it from others by."""
        return ", ".join(f"{path}={value}" for path, value in self.values.items())


def matrix_problems(plain: Mapping[str, Any]) -> Iterator[Problem]:
    """Yield what keeps the matrix of a playbook, as it was read, from being laid out at all."""
    matrix = plain.get("matrix") or {}
    for path in matrix:
        node: Any = plain
        *above, _ = keys = path.split(".")
        if not all(keys):
            yield ("matrix", path), "is no path of keys: write it as sensor.sigma_deg"
        elif keys[0] in FIXED:
            yield ("matrix", path), f"{keys[0]} is the same in all runs of a playbook"
        for key in above:
            node = node.get(key, {}) if isinstance(node, dict) else None
        if not isinstance(node, dict):
            yield ("matrix", path), f"{'.'.join(above)} is one value and has no parts"
    count = math.prod(len(values) for values in matrix.values())
    if count > MOST_RUNS:
        yield ("matrix",), f"makes {count} runs (allowed are {MOST_RUNS}): fly it as several playbooks"


def single_values(plain: Mapping[str, Any]) -> Iterator[tuple[Location, Values]]:
    """Yield each value of the matrix with its place in the playbook."""
    for path, values in (plain.get("matrix") or {}).items():
        for number, value in enumerate(values):
            yield ("matrix", path, number), {path: value}


def combinations(plain: Mapping[str, Any]) -> Iterator[Values]:
    """Yield the values of every run; of one that changes nothing where there is no matrix."""
    matrix = plain.get("matrix") or {}
    for values in itertools.product(*matrix.values()):
        yield dict(zip(matrix, values, strict=True))


def changed(plain: Mapping[str, Any], values: Values) -> dict[str, Any]:
    """Return a playbook as read with other values, and without its matrix; the one given stays as it is."""
    made = {key: value for key, value in plain.items() if key != "matrix"}
    for path, value in values.items():
        *above, last = path.split(".")
        node = made
        for key in above:
            node[key] = dict(node.get(key) or {})
            node = node[key]
        node[last] = value
    return made
