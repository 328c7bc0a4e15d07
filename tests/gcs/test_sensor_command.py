"""The sensor command: a sensor in a process of its own, over a real bus, and what a user may get wrong."""

from __future__ import annotations

import asyncio
import contextlib
import json
import re
import subprocess
import sys
import time
from collections.abc import AsyncIterator, Callable
from pathlib import Path

import pytest

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Bearing, BearingReport, ClockPing, ClockPong, decode, encode
from drivers.bus.session import Bus, BusEndpoint, open_bus
from drivers.errors import SensorError
from drivers.simulation.launcher import free_tcp_port
from gcs.commands.sensor import SensorKind, sensor
from gcs.errors import ServiceError

KEYS = SwarmKeys("three")
COMMAND = [sys.executable, "-c", "import typer; from gcs.commands.sensor import sensor; typer.run(sensor)"]
README = Path(__file__).parents[2] / "README.md"
GOOD = {"kind": SensorKind["replay"], "swarm": "three", "uav": "U1", "connect": "tcp/127.0.0.1:7447"}


def test_the_schema_is_printed_for_other_languages(capsys: pytest.CaptureFixture[str]) -> None:
    sensor(schema=True)
    published = json.loads(capsys.readouterr().out)
    assert {"BearingReport", "ClockPing", "ClockPong"} <= published["$defs"].keys()
    assert set(published["$defs"]["BearingReport"]["required"]) == {"captured_ns", "sequence", "reference", "bearings"}


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"kind": None}, "krakensdr, replay"),
        ({"swarm": ""}, "--swarm"),
        ({"swarm": "a/b"}, "--swarm"),
        ({"uav": "*"}, "--uav"),
        ({"connect": ""}, "--connect"),
        ({"connect": "10.0.0.1:7447"}, "--connect"),
        ({"settings": Path("no_such_file.yaml")}, "no_such_file.yaml cannot be read"),
    ],
)
def test_what_is_missing_or_wrong_is_named(changes: dict[str, object], says: str) -> None:
    with pytest.raises(ServiceError, match=re.escape(says)):
        sensor(**(GOOD | changes))


@pytest.mark.parametrize(
    ("text", "says"),
    [("", "path"), ("path: 3", "path"), ("[1, 2]", "replay"), ("pth: x", "pth"), ("path: [", "cannot be read")],
)
def test_settings_that_cannot_be_used_are_refused(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "sensor.yaml"
    path.write_text(text)
    with pytest.raises((SensorError, ServiceError), match=says):
        sensor(**GOOD, settings=path)


async def until(condition: Callable[[], object], timeout_s: float = 60.0) -> None:
    async with asyncio.timeout(timeout_s):
        while not condition():  # noqa: ASYNC110 - other processes have no event to wait for
            await asyncio.sleep(0.02)


@contextlib.asynccontextmanager
async def started(*arguments: str) -> AsyncIterator[asyncio.subprocess.Process]:
    process = await asyncio.create_subprocess_exec(*arguments, stderr=asyncio.subprocess.PIPE)
    try:
        yield process
    finally:
        with contextlib.suppress(ProcessLookupError):
            process.kill()
        await process.wait()


def reports_on(bus: Bus) -> list[BearingReport]:
    """The reports of U1 on a bus, as they come."""
    came: list[BearingReport] = []
    bus.subscribe(KEYS.bearings("U1"), lambda _, payload: came.append(decode(payload, BearingReport)))
    return came


@pytest.mark.slow
async def test_a_sensor_waits_for_its_bus_publishes_answers_and_ends_when_told_to(tmp_path: Path) -> None:
    recorded, settings = tmp_path / "reports.jsonl", tmp_path / "replay.yaml"
    report = BearingReport(1, 1, "true_north", [Bearing("L0", 1.0, 0.01)])
    recorded.write_bytes(encode(report))
    settings.write_text(f"path: {recorded}\nrepeat: true\n")
    endpoint = f"tcp/127.0.0.1:{free_tcp_port()}"
    options = ("--swarm", "three", "--uav", "U1", "--connect", endpoint, "--settings", str(settings))
    async with started(*COMMAND, "replay", *options) as process:
        assert process.stderr is not None
        assert b"Trying again" in await asyncio.wait_for(process.stderr.readline(), 20.0)
        for _ in range(2):  # the ground may also be restarted
            began_ns = time.time_ns()
            async with open_bus(BusEndpoint(endpoint, role="router")) as bus:
                reports, pongs = reports_on(bus), []
                bus.subscribe(KEYS.clock_pong("U1"), lambda _, payload: pongs.append(decode(payload, ClockPong)))  # noqa: B023
                await until(lambda: len(reports) > 5)  # noqa: B023
                bus.put_latest(KEYS.clock_ping("U1"), encode(ClockPing(asked_ns=4711)), urgent=True)
                await until(lambda: pongs)  # noqa: B023
                assert pongs[0].asked_ns == 4711
                assert began_ns <= pongs[0].received_ns <= pongs[0].answered_ns <= time.time_ns()
                assert began_ns <= reports[-1].captured_ns <= time.time_ns()
        process.terminate()
        assert await asyncio.wait_for(process.wait(), 10.0) == 0


@pytest.mark.slow
async def test_the_example_in_the_readme_puts_bearings_on_the_bus() -> None:
    (example,) = (text for text in re.findall(r"```python\n(.*?)```", README.read_text(), re.S) if "zenoh" in text)
    assert len(example.strip().splitlines()) <= 12
    endpoint, began_ns = f"tcp/127.0.0.1:{free_tcp_port()}", time.time_ns()
    assert "tcp/10.0.0.1:7447" in example
    program = example.replace("tcp/10.0.0.1:7447", endpoint)
    async with open_bus(BusEndpoint(endpoint, role="router")) as bus:
        reports = reports_on(bus)
        async with started(sys.executable, "-c", program) as process:
            await until(lambda: len(reports) > 3)
            assert process.returncode is None or process.returncode == 0
    assert reports[0].reference == "true_north"
    assert all(began_ns <= report.captured_ns <= time.time_ns() for report in reports)
    assert len({report.bearings[0].azimuth_rad for report in reports}) == len(reports)


@pytest.mark.slow
def test_help_names_every_kind() -> None:
    told = subprocess.run([*COMMAND, "--help"], capture_output=True, text=True, check=True)
    assert "krakensdr" in told.stdout
    assert "replay" in told.stdout
