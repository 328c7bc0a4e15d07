"""What reads bytes that strangers may have written: of each an honest example, and what may come of any others."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any, Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.aoa.kinds import read_settings
from drivers.aoa.krakensdr import KrakenReader
from drivers.bus import messages, run_messages
from drivers.bus.messages import BearingReport, MalformedMessageError, decode
from drivers.bus.refusal_log import Tally
from drivers.bus.run_messages import decode_run
from drivers.mavlink.codec import Codec, FrameSplitter
from gcs.errors import ServiceError
from gcs.playbook.loader import PlaybookError, load_runs
from gcs.recording.journal_reading import entries_of
from gcs.recording.mcap_file import McapFiles, SizeLimits
from gcs.recording.mcap_reading import read_flight

KRAKEN_LINES: Final = Path("tests/drivers/aoa/golden/kraken_compass.csv")
KRAKEN_SETTINGS: Final[Mapping[str, Any]] = {
    "url": "http://127.0.0.1:8081/DOA_value.html",
    "transmitters_mhz": {"L0": 433.92, "L1": 434.5},
    "direction": "clockwise",
    "zero_deg": 0,
    "heading": "none",
    "sigma": [{"confidence_db": 2, "sigma_deg": 6}, {"confidence_db": 5, "sigma_deg": 3}],
}
_REPORT: Final = {
    "captured_ns": 1_800_000_000_000_000_000,
    "sequence": 1,
    "reference": "true_north",
    "bearings": [{"transmitter": "L0", "azimuth_rad": 1.0, "sigma_rad": 0.01}],
    "resolution_rad": 0.017,
}
_ENTRY: Final = {"time_ns": 1_800_000_000_000_000_000, "receiver": "U1", "slot": "O1", "state": "LEG_1", "reason": ""}


@cache
def _folder() -> Path:
    return Path(tempfile.mkdtemp(prefix="readers-"))


def _a_report() -> bytes:
    return json.dumps(_REPORT).encode()


def _read_message(payload: bytes) -> None:
    for kinds, read in ((messages.KINDS, decode), (run_messages.KINDS, decode_run)):
        for kind in kinds:
            with suppress(MalformedMessageError):
                read(payload, kind)


def _a_playbook() -> bytes:
    return Path("sitl_configs/four.yaml").read_bytes()


def _read_playbook(text: bytes) -> None:
    path = _folder() / "playbook.yaml"
    path.write_bytes(text)
    with suppress(PlaybookError):
        load_runs(path)


def _a_heartbeat() -> bytes:
    packed: bytes = mavlink.MAVLink_heartbeat_message(2, 3, 0, 4, 4, 3).pack(mavlink.MAVLink(None, 3, 1))
    return packed


def _read_mavlink(data: bytes) -> None:
    codec, splitter = Codec(), FrameSplitter()
    for frame in (*splitter.datagram(data), *splitter.stream(data)):
        if codec.accepts(frame):
            codec.decode(frame)


def _read_kraken(text: bytes) -> None:
    reader = KrakenReader(read_settings("krakensdr", KRAKEN_SETTINGS))  # type: ignore[arg-type]
    reader.reports(text.decode(errors="replace"), int(KRAKEN_LINES.read_bytes().split(b",")[0]) + 100)


def _a_recording() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        files = McapFiles(Path(folder), {}, SizeLimits(reserve_bytes=0))
        for number in range(3):
            files.write("bearing-relay/two/uav/U1/bearings", BearingReport, number * 10**8, _a_report())
        files.finish()
        return (Path(folder) / "flight.mcap").read_bytes()


def _read_recording(data: bytes) -> None:
    (_folder() / "flight.mcap").write_bytes(data)
    with suppress(ServiceError):
        list(read_flight(_folder(), lambda complaint: None))


def _a_journal() -> bytes:
    return b"\n".join([json.dumps(_ENTRY).encode()] * 2)


def _read_journal(data: bytes) -> None:
    lines = data.splitlines()
    read = entries_of(lines)
    assert len(read.entries) + len(read.lost) == len(lines)


def _an_event() -> bytes:
    said = "2da on Interface(lo)+CertCommonName(uav.U1)+Transport(Tls)+2da is unauthorized to Put (ingress) on a/b"
    source = "zenoh::net::routing::interceptor::access_control"
    return f"2026-08-06T05:54:31.491952Z TRACE  rx-0 ThreadId(07) {source}: {said}\n".encode()


def _read_event(event: bytes) -> None:
    tally = Tally({"uav.U1"})
    tally.take(event)
    assert tally.refusals.total <= 1


Reader = tuple[Callable[[], bytes], Callable[[bytes], None]]
READERS: Final[Mapping[str, Reader]] = {
    "message": (_a_report, _read_message),
    "playbook": (_a_playbook, _read_playbook),
    "mavlink": (_a_heartbeat, _read_mavlink),
    "kraken": (KRAKEN_LINES.read_bytes, _read_kraken),
    "recording": (_a_recording, _read_recording),
    "journal": (_a_journal, _read_journal),
    "event": (_an_event, _read_event),
}
"""An honest example and the reader, by name. A reader lets nothing out but what the user may see."""
