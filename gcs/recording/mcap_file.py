"""MCAP files of one flight: flight.mcap, and when that is full flight-2.mcap and on, each complete in itself."""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import BinaryIO, Final

import msgspec
from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import Writer

from gcs.recording.topics import schema_of

_FLUSH_NS: Final = 80_000_000
"""So much of a flight is lost at most when the service is killed."""


@dataclass(frozen=True)
class SizeLimits:
    """How large a recording may get, and what it leaves on the disk for the journal, bytes."""

    part_bytes: int = 256 * 2**20
    total_bytes: int = 8 * 2**30
    reserve_bytes: int = 128 * 2**20


class RecordingFullError(OSError):
    """A limit is reached; what was recorded until then is complete."""


@dataclass
class _Part:
    """One file, being written."""

    path: Path
    stream: BinaryIO
    writer: Writer
    schemas: dict[str, int] = field(default_factory=dict)
    channels: dict[tuple[str, str], int] = field(default_factory=dict)

    def channel(self, topic: str, message: type[msgspec.Struct] | None) -> int:
        """Return the channel of a topic, made when it is first wanted; without a message, JSON of any form."""
        name = "" if message is None else message.__name__
        if (topic, name) not in self.channels:
            schema_id = 0 if message is None else self._schema(message)
            self.channels[topic, name] = self.writer.register_channel(topic, MessageEncoding.JSON, schema_id)
        return self.channels[topic, name]

    def _schema(self, message: type[msgspec.Struct]) -> int:
        if message.__name__ not in self.schemas:
            self.schemas[message.__name__] = self.writer.register_schema(
                message.__name__, SchemaEncoding.JSONSchema, schema_of(message)
            )
        return self.schemas[message.__name__]


class McapFiles:
    """Writes messages in the order they are given; every method may raise OSError, RecordingFullError among them."""

    def __init__(
        self,
        folder: Path,
        about: Mapping[str, str],
        limits: SizeLimits,
        free_bytes: Callable[[Path], int] = lambda folder: shutil.disk_usage(folder).free,
    ) -> None:
        self.paths: list[Path] = []
        self.size_bytes = 0
        self.folder = folder
        self._about = dict(about)
        self._limits = limits
        self._free_bytes = free_bytes
        self._part: _Part | None = None
        self._flushed_ns = 0
        self._flushed = True

    def write(self, topic: str, message: type[msgspec.Struct] | None, time_ns: int, payload: bytes) -> None:
        """Add a message; what was added a tenth of a second before it is in the file."""
        part = self._part or self._begin(time_ns)
        part.writer.add_message(part.channel(topic, message), time_ns, payload, time_ns)
        self._flushed = False
        if time_ns - self._flushed_ns >= _FLUSH_NS:
            self._flushed_ns = time_ns
            self._flush(part)

    def settle(self) -> None:
        """Put into the file what was added last, for it may be long until something follows."""
        if self._part is not None and not self._flushed:
            self._flush(self._part)

    def finish(self) -> None:
        """Complete the file being written."""
        part, self._part = self._part, None
        if part is not None:
            with part.stream:
                part.writer.finish()

    def give_up(self) -> None:
        """Let go of a file that cannot be written any more: what was flushed stays readable."""
        part, self._part = self._part, None
        if part is not None:
            with contextlib.suppress(OSError):
                part.stream.close()

    def _begin(self, time_ns: int) -> _Part:
        self._require_space()
        path = _next_path(self.folder)
        stream = path.open("xb")
        part = self._part = _Part(path, stream, Writer(stream))
        self.paths.append(path)
        self._flushed_ns = time_ns
        part.writer.start()
        part.writer.add_metadata("bearing-relay", self._about)
        return part

    def _flush(self, part: _Part) -> None:
        part.writer.flush()
        self._flushed = True
        written = part.stream.tell()
        if self.size_bytes + written >= self._limits.total_bytes:
            self.finish()
            raise RecordingFullError(f"the recording has reached its {self._limits.total_bytes / 1e6:.0f} MB")
        if written >= self._limits.part_bytes:
            self.size_bytes += written
            self.finish()
        else:
            self._require_space()

    def _require_space(self) -> None:
        free = self._free_bytes(self.folder)
        if free < self._limits.reserve_bytes:
            self.finish()
            raise RecordingFullError(f"only {free / 1e6:.0f} MB are left on the disk, which the journal needs")


def _next_path(folder: Path) -> Path:
    names = (f"flight-{number}.mcap" if number > 1 else "flight.mcap" for number in count(1))
    return next(path for name in names if not (path := folder / name).exists())
