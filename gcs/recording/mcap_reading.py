"""What was recorded of a flight, read back in the order it was written: flight.mcap, flight-2.mcap and on."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mcap.exceptions import EndOfFile, InvalidMagic
from mcap.records import Channel, Message, Statistics
from mcap.stream_reader import StreamReader

from gcs.errors import ServiceError

_LARGEST_RECORD_BYTES: Final = 64 * 2**20
"""None that this program writes comes near: a larger one is damage."""
_PART: Final = re.compile(r"flight(?:-(\d+))?\.mcap")


@dataclass(frozen=True)
class Recorded:
    """One message of a recording; `time_ns` is when it was recorded, ns since 1970."""

    topic: str
    time_ns: int
    payload: bytes


def read_flight(folder: Path, complain: Callable[[str], None]) -> Iterator[Recorded]:
    """Yield every message in a run's folder that can be read.

    Where a file breaks off or is damaged, `complain` is told in words, and what follows in that file is left out.
    ServiceError when there is no recording, or what is called one is of another kind.
    """
    parts = parts_of(folder)
    if not parts:
        raise ServiceError(
            f"{folder} holds no flight.mcap: name the folder of a run, and look into its journal.jsonl "
            "whether recording began"
        )
    for number, path in enumerate(parts, start=1):
        if _number(path) != number:
            complain(f"a part of the recording is missing before {path.name}")
            break
        yield from _read_part(path, complain)


def parts_of(folder: Path) -> list[Path]:
    """Return the files of a recording, first to last."""
    try:
        return sorted((path for path in folder.iterdir() if _PART.fullmatch(path.name)), key=_number)
    except OSError as error:
        raise ServiceError(f"{folder} cannot be read: {error}") from error


def _number(path: Path) -> int:
    match = _PART.fullmatch(path.name)
    return int(match[1] or 1) if match else 0


def _read_part(path: Path, complain: Callable[[str], None]) -> Iterator[Recorded]:
    topics: dict[int, str] = {}
    count = 0
    try:
        with path.open("rb") as stream:
            reader = StreamReader(stream, validate_crcs=True, record_size_limit=_LARGEST_RECORD_BYTES)
            for record in reader.records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message):
                    yield Recorded(topics[record.channel_id], record.log_time, record.data)
                    count += 1
                elif isinstance(record, Statistics) and record.message_count != count:
                    lost = record.message_count - count
                    complain(f"{path.name} is damaged: {lost} of its {record.message_count} messages are not there")
    except OSError as error:
        raise ServiceError(f"{path} cannot be read: {error}") from error
    except Exception as error:  # what is in a damaged file makes its reader raise anything
        if isinstance(error, InvalidMagic) and not topics:
            raise ServiceError(f"{path} is no MCAP file") from error
        how = "breaks off" if isinstance(error, EndOfFile) else f"is cut or damaged ({error!r})"
        complain(
            f"{path.name} {how} after {count} messages: what follows in it is missing here. A service that is killed "
            "leaves such a file; `mcap recover` makes it whole for other tools"
        )
