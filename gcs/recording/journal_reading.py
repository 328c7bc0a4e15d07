"""A journal read back. A service that was killed may have cut a line off: it is skipped, and said."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from drivers.strict_json import MalformedError, read_json
from gcs.errors import ServiceError
from gcs.relay.states import ReceiverState
from planner.plan import Route, plan_from_json

_SHOWN: Final = 60

Pair = tuple[float, float]


class KnownOfReceiver(msgspec.Struct, frozen=True):
    """What a receiver's entry knows beyond its words."""

    place_m: Pair | None = None
    covariance_m2: tuple[Pair, Pair] | None = None
    route: dict[str, Any] | None = None


class Change(msgspec.Struct, frozen=True):
    """A receiver's change."""

    time_ns: int
    receiver: str
    state: ReceiverState
    reason: str = ""
    known: KnownOfReceiver = KnownOfReceiver()

    @property
    def place(self) -> complex | None:
        """Where bearings put it last, formation frame, m."""
        return None if self.known.place_m is None else complex(*self.known.place_m)

    @property
    def covariance(self) -> NDArray[np.float64] | None:
        """The covariance of that place, m^2."""
        return None if self.known.covariance_m2 is None else np.array(self.known.covariance_m2)

    @property
    def route(self) -> Route | None:
        """Its route at that time, where the line holds one."""
        whole = {"method": "", "straight_line_bound_m": 0.0, "makespan_s": 0.0, "emission_transmitter_s": 0.0}
        try:
            return plan_from_json(whole | {"receivers": [self.known.route]}).routes[0]
        except (LookupError, TypeError, AttributeError, ArithmeticError, ValueError):
            return None


class StageChange(msgspec.Struct, frozen=True):
    """A stage that began, or how it ended."""

    time_ns: int
    stage: str
    kind: str
    state: str


class KnownOfRelay(msgspec.Struct, frozen=True):
    """What an entry of the relay knows beyond its words."""

    taken: frozenset[str]
    given_up: frozenset[str]


class Said(msgspec.Struct, frozen=True):
    """What was said of the run as a whole."""

    time_ns: int
    relay: str
    known: KnownOfRelay | None = None


Entry = Change | StageChange | Said


@dataclass(frozen=True)
class LostLine:
    """A line that could not be read, counted from 1."""

    number: int
    text: str

    def __str__(self) -> str:
        return f"line {self.number} is not whole and was lost: {self.text}"


@dataclass(frozen=True)
class JournalRead:
    """What a journal says, in order, and what of it could not be read."""

    entries: tuple[Entry, ...]
    lost: tuple[LostLine, ...]


def read_journal(path: Path) -> JournalRead:
    """Return what a journal says. ServiceError when there is none."""
    try:
        return entries_of(path.read_bytes().splitlines())
    except OSError as error:
        raise ServiceError(f"{path} cannot be read: {error}. Name the folder of a run") from error


def entries_of(lines: Sequence[bytes]) -> JournalRead:
    """Return what the lines of a journal say."""
    entries: list[Entry] = []
    lost: list[LostLine] = []
    for number, line in enumerate(lines, start=1):
        try:
            entries.append(_entry(line))
        except MalformedError:
            lost.append(LostLine(number, line[:_SHOWN].decode(errors="replace")))
    return JournalRead(tuple(entries), tuple(lost))


def _entry(line: bytes) -> Entry:
    told = read_json(line, dict[str, Any])
    if "receiver" in told:
        return msgspec.convert(told, Change)
    if "stage" in told:
        return msgspec.convert(told, StageChange)
    return msgspec.convert(told, Said)
