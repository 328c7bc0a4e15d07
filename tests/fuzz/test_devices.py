"""What sensors, key files and links are given to read: it is understood, or refused in words."""

from __future__ import annotations

import asyncio
import contextlib
import json
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from drivers.aoa.http_text import HttpAddress, fetch_text
from drivers.aoa.kinds import read_settings
from drivers.aoa.krakensdr import KrakenReader
from drivers.bus.certificates import Authority, now
from drivers.bus.messages import BearingReport, decode, encode
from drivers.bus.security import SERVICE, configurations, with_keys
from drivers.bus.session import BusEndpoint, open_bus
from drivers.mavlink.signing_key import SigningKey
from drivers.mavlink.transport import LinkAddress
from tests.fakes import FAKE_UNIX_NS, ManualClock
from tests.fuzz.hostile import as_json, damaged, ends_well, examples, mutated, values
from tests.fuzz.readers import KRAKEN_LINES, KRAKEN_SETTINGS

KRAKEN = dict(KRAKEN_SETTINGS)
LINES = KRAKEN_LINES.read_bytes()
CAPTURED_MS = int(LINES.split(b",")[0])
ENDPOINT = "tls/127.0.0.1:1"
KEYS = json.loads(configurations("two", ["U1"], ENDPOINT, Authority("two", now(), 2))[SERVICE])


@examples(60)
@given(kind=st.sampled_from(("krakensdr", "replay")), data=st.data())
def test_the_settings_of_a_sensor(kind: str, data: st.DataObject) -> None:
    good = KRAKEN if kind == "krakensdr" else {"path": "reports.jsonl", "repeat": False}
    given_values = json.loads(as_json(data.draw(mutated(good) | values)))
    with ends_well():
        read_settings(kind, given_values).open(ManualClock())


@examples(100)
@given(text=damaged(LINES))
def test_the_lines_of_a_kraken(text: bytes) -> None:
    reader = KrakenReader(read_settings("krakensdr", KRAKEN))  # type: ignore[arg-type]
    reports = reader.reports(text.decode(errors="replace"), CAPTURED_MS + 100)
    for report in reports:
        assert decode(encode(report), BearingReport) == report
    assert len(reports) + sum(reader.counts.values()) >= bool(text.strip())


@examples(25)
@given(answer=damaged(b"HTTP/1.1 200 OK\r\nContent-Length: 10\r\n\r\n0123456789") | st.binary(max_size=200))
def test_a_web_server_that_says_anything(answer: bytes) -> None:
    async def fetch() -> str:
        async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
                await reader.readuntil(b"\r\n\r\n")
                writer.write(answer)
                await writer.drain()
            writer.close()

        async with await asyncio.start_server(serve, "127.0.0.1", 0) as server:
            port = server.sockets[0].getsockname()[1]
            return await fetch_text(HttpAddress.parse(f"http://127.0.0.1:{port}/"), 5.0, 1000)

    with ends_well():
        assert len(asyncio.run(fetch())) <= 1000


@examples(30)
@given(data=st.data())
def test_a_file_of_reports_that_is_replayed(tmp_path: Path, data: st.DataObject) -> None:
    bearing = {"transmitter": "L0", "azimuth_rad": 1.0, "sigma_rad": 0.01}
    good = [
        {"captured_ns": FAKE_UNIX_NS + number, "sequence": number, "reference": "true_north", "bearings": [bearing]}
        for number in range(3)
    ]
    path = tmp_path / "reports.jsonl"
    path.write_bytes(data.draw(damaged(b"\n".join(map(as_json, good))) | mutated(good).map(as_json)))
    clock, published = ManualClock(), []

    async def replay() -> None:
        sensor = read_settings("replay", {"path": str(path)}).open(clock)
        running = asyncio.ensure_future(sensor.run(published.append, lambda _: None))
        while not running.done():
            await clock.advance(1e9)
        await running

    with ends_well():
        asyncio.run(replay())
    assert len(published) <= 3 + 4


@examples(40)
@given(data=st.data())
def test_a_file_of_keys(tmp_path: Path, data: st.DataObject) -> None:
    path = tmp_path / "service.json5"
    path.touch(0o600)
    path.write_bytes(data.draw(mutated(KEYS).map(as_json) | damaged(as_json(KEYS)) | st.binary(max_size=40)))

    async def join() -> None:
        async with open_bus(with_keys(BusEndpoint(ENDPOINT), path)):
            raise AssertionError("nobody is there")

    with ends_well():
        asyncio.run(join())


@examples(100)
@given(text=st.binary(max_size=80) | st.sampled_from((b"0" * 64, b"A" * 44, b"\x00" * 64, b"f" * 100_000)))
def test_a_signing_key(tmp_path: Path, text: bytes) -> None:
    path = tmp_path / "key"
    path.touch(0o600)
    path.write_bytes(text)
    with ends_well():
        SigningKey.from_file(path)


@examples(150)
@given(text=damaged(b"udpin:127.0.0.1:14550") | damaged(b"serial:/dev/ttyUSB0:57600") | st.binary(max_size=30))
def test_the_address_of_a_link(text: bytes) -> None:
    with ends_well():
        LinkAddress.parse(text.decode(errors="surrogateescape"))
