"""Ways to spoil a playbook, each with the line where its reader has to find it: made from the ready playbooks."""

from __future__ import annotations

import random
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq

CONFIGS = Path(__file__).parents[3] / "sitl_configs"
READY = sorted(CONFIGS.rglob("*.yaml"))

NAMES = frozenset({"transmitters", "receivers", "vehicles", "vehicle_types", "slots", "expect", "matrix"})
"""What is below these is called as the user likes."""
POSITIVE = frozenset(
    {"radius_m", "spacing_m", "sides", "altitude_m", "speed_mps", "rate_hz", "min_separation_m", "for_s", "timeout_s"}
)
CHOSEN = {
    "method": "magic", "objective": "luck", "kind": "ring", "fault": "fire", "on_failure": "panic", "state": "LEG_9",
    "outcome": "fromed", "vehicle": "U77", "receiver": "U77",
}  # fmt: skip
CONDITIONS = ('"< much"', '"2 .. 1"', '"<"', '"~"', "[]")
NONSENSE = ("nonsense", "[1, 2]", "{a: b}", "true", ".nan")
VALUE = re.compile(r"""'[^']*'|"[^"]*"|[^,\]}\n#"'\[{]+""")


@dataclass(frozen=True)
class Damage:
    """A playbook that is spoilt, and the lines where that has to be said: from `first` to `last`, counted from 1."""

    name: str
    text: str
    first: int
    last: int


@dataclass(frozen=True)
class Spot:
    """A key, or an item of a list, and its value where that is no mapping or list; lines and columns from 0."""

    path: tuple[str | int, ...]
    key_at: tuple[int, int]
    value_at: tuple[int, int] | None
    value: Any


def damages(seed: int, most: int) -> list[Damage]:
    """Return spoilt playbooks, of every kind about as many."""
    chance = random.Random(seed)
    by_kind: dict[str, list[Damage]] = {}
    for path in READY:
        for damage in _of(path):
            by_kind.setdefault(damage.name.split()[0], []).append(damage)
    for found in by_kind.values():
        chance.shuffle(found)
    drawn: list[Damage] = []
    while len(drawn) < most and any(by_kind.values()):
        drawn += [found.pop() for found in by_kind.values() if found]
    return drawn[:most]


def _of(path: Path) -> Iterator[Damage]:
    text = path.read_text(encoding="utf-8")
    document = YAML(typ="rt").load(text)
    lines = text.splitlines()
    for spot in _spots(document, ()):
        yield from _spoilt(path.stem, lines, spot)
    yield from _without_sections(path.stem, lines, document)
    yield from _broken(path.stem, lines)


def _spots(node: Any, above: tuple[str | int, ...]) -> Iterator[Spot]:
    keys = node if isinstance(node, CommentedMap) else range(len(node))
    for key in keys:
        key_at = node.lc.key(key) if isinstance(node, CommentedMap) else node.lc.item(key)
        value, path = node[key], (*above, key)
        deeper = isinstance(value, CommentedMap | CommentedSeq)
        value_at = node.lc.value(key) if isinstance(node, CommentedMap) else key_at
        yield Spot(path, key_at, None if deeper else value_at, value)
        if deeper:
            yield from _spots(value, path)


def _spoilt(stem: str, lines: list[str], spot: Spot) -> Iterator[Damage]:
    """Yield what can be done to one key and its value."""
    key, where = spot.path[-1], f"{stem} {'.'.join(map(str, spot.path))}"
    above = spot.path[-2] if len(spot.path) > 1 else ""
    if isinstance(key, str) and (above not in NAMES or above in ("expect", "matrix")):
        yield _changed(f"misspelt {where}", lines, spot.key_at, key, key[:-1] + "qx")
    if above == "expect":
        yield _changed(f"figure {where}", lines, spot.key_at, str(key), f"{key}.U77")
    if spot.value_at is None or spot.value is None:
        return
    written = _written(lines, spot.value_at)
    for kind, instead in _instead(spot, str(above)):
        yield _changed(f"{kind} {where} {instead}", lines, spot.value_at, written, instead)


def _instead(spot: Spot, above: str) -> Iterator[tuple[str, str]]:
    """Yield what may stand wrongly in the place of a value, each with what is wrong about it."""
    key, value = spot.path[-1], spot.value
    if key != "playbook" and (isinstance(value, int | float) or value[:1] in "<>=0123456789"):
        yield from (("nonsense", nonsense) for nonsense in NONSENSE if not (nonsense == "true" and value is True))
    if key in POSITIVE and not {"start", "at", "expect"} & set(spot.path):
        yield "negative", "-3"
    if key in CHOSEN:
        yield "unknown", CHOSEN[str(key)]
    if above == "stages":
        yield "no-stage", "tekoff"
    if above == "expect":
        yield from (("condition", condition) for condition in CONDITIONS)
    if "matrix" in spot.path:
        yield "matrix-value", "{x: 1}"


def _without_sections(stem: str, lines: list[str], document: CommentedMap) -> Iterator[Damage]:
    """Yield the playbook without one of the sections it must have, and with a matrix that leads nowhere."""
    for section in ("playbook", "name", "formation", "transmitters", "receivers"):
        at, _ = document.lc.key(section)
        end = next((row for row in range(at + 1, len(lines)) if lines[row][:1] not in ("", " ", "#")), len(lines))
        yield Damage(
            f"without {stem} {section}", "\n".join(lines[:at] + lines[end:]), 1, _first_key(lines[:at] + lines[end:])
        )
    if "matrix" not in document:
        for written in (
            "stages: [1]",
            "sensor.sigma_deg.x: [1]",
            "seed: []",
            "sensor..x: [1]",
            "fligth.speed_mps: [4]",
        ):
            row = len(lines) + 2
            yield Damage(f"matrix {stem} {written}", "\n".join([*lines, "matrix:", f"  {written}"]), row - 1, row)


def _first_key(lines: list[str]) -> int:
    return next(row for row, line in enumerate(lines, start=1) if line and line[0] not in " #")


def _broken(stem: str, lines: list[str]) -> Iterator[Damage]:
    """Yield text that is no YAML any more: noticed where it is or soon after, or where what it opens is not closed."""
    for row, line in enumerate(lines):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        for sign in ("]", "}", "\t- x", ": :"):
            text = "\n".join([*lines[:row], line.split(" #")[0] + sign, *lines[row + 1 :]])
            yield Damage(f"broken {stem} {row + 1} {sign!r}", text, row + 1, row + 3)
        text = "\n".join([*lines[:row], line.split(" #")[0] + " [", *lines[row + 1 :]])
        yield Damage(f"unclosed {stem} {row + 1}", text, row + 1, len(lines) + 1)
        if not line.startswith((" ", "-")):
            key = line.split(":")[0]
            yield Damage(f"twice {stem} {key}", "\n".join([*lines, f"{key}: 1"]), row + 1, len(lines) + 1)


def _written(lines: list[str], at: tuple[int, int]) -> str:
    found = VALUE.match(lines[at[0]], at[1])
    assert found is not None, lines[at[0]]
    return found.group().rstrip()


def _changed(name: str, lines: list[str], at: tuple[int, int], old: str, new: str) -> Damage:
    row, column = at
    line = lines[row]
    assert line[column:].startswith(old), (line, old)
    changed = line[:column] + new + line[column + len(old) :]
    first = row if " formation.kind" in name else row + 1  # said of the formation
    return Damage(name, "\n".join([*lines[:row], changed, *lines[row + 1 :]]), first, row + 1)
