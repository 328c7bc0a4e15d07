"""Fencing tokens: a number for each time a vehicle is given to a node. It never falls, whoever is restarted."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Collection
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import msgspec

from gcs.errors import ServiceError

FILE: Final = "tokens.jsonl"


class Given(msgspec.Struct, frozen=True):
    """A vehicle was given to a node with this token."""

    vehicle: str
    node: str
    token: int


@dataclass
class Tokens:
    """Gives tokens out, each on the disk before it is used. `floor` is below all of them: the time, ms since 1970.

    So those of a later run are higher, too, and nodes that outlive a run obey the next.
    """

    path: Path
    floor: int
    last: dict[str, Given] = field(default_factory=dict)
    """The last given for each vehicle, of this run, also by an earlier service."""

    def __post_init__(self) -> None:
        with contextlib.suppress(FileNotFoundError):
            for line in self.path.read_bytes().splitlines():
                with contextlib.suppress(msgspec.MsgspecError):  # cut off as it was written: it was never used
                    given = msgspec.json.decode(line, type=Given)
                    self.last[given.vehicle] = given

    def give(self, vehicles: Collection[str], node: str) -> dict[str, int]:
        """Return a new token for each vehicle. ServiceError when they cannot be kept: then nothing is given."""
        given = [Given(name, node, self._next(name)) for name in vehicles]
        lines = b"".join(b"\n" + msgspec.json.encode(each) for each in given)
        try:
            with self.path.open("ab") as file:
                file.write(lines + b"\n")
                file.flush()
                os.fsync(file.fileno())
        except OSError as error:
            raise ServiceError(f"{self.path} cannot be written: {error}. No vehicle is given to {node}") from error
        self.last |= {each.vehicle: each for each in given}
        return {each.vehicle: each.token for each in given}

    def _next(self, vehicle: str) -> int:
        return max(self.floor, self.last[vehicle].token if vehicle in self.last else 0) + 1
