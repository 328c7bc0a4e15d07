"""The time series of a run: flown by the real executor in virtual time, written, and read back."""

from __future__ import annotations

import asyncio
import math
from collections import Counter
from pathlib import Path

import msgspec
import pytest

from drivers.bus.messages import Emission, encode
from gcs.recording.lines import open_lines
from gcs.recording.series import LegBegun, LegEnded, Series, SeriesLine, Switched, Tick, read_line
from gcs.relay.records import LegRecord
from gcs.relay.states import ReceiverState
from gcs.safety import PositionBoard, SitePosition
from gcs.status import RunStatus
from tests.fakes import FakeBus, settle
from tests.gcs.relay.world import World


def lines_of(path: Path) -> list[SeriesLine]:
    return [read_line(line) for line in path.read_bytes().splitlines()]


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[World, list[SeriesLine]]:
    """The paper's eight, flown in virtual time with everything recorded."""
    path = tmp_path_factory.mktemp("run") / "series.jsonl"
    world, board = World(), PositionBoard()

    def told(_: float) -> None:
        for name, vehicle in world.vehicles.items():
            board.latest[name] = SitePosition(world.clock.now_s(), vehicle.place, 20.0)

    async def fly() -> None:
        status = RunStatus("paper-8", world.clock, records=world.executor.records)
        with open_lines(path, synced=False) as lines:
            series = Series(lines, status, board, world.frame, world.clock)
            series.attach(world.bus, world.keys)
            recording = asyncio.create_task(series.record())
            await world.run(meanwhile=told)
            series.sample()
            recording.cancel()

    asyncio.run(fly())
    return world, lines_of(path)


def test_every_leg_begins_and_ends_where_the_relay_says(flown: tuple[World, list[SeriesLine]]) -> None:
    world, lines = flown
    begun = {(line.receiver, line.number): line for line in lines if isinstance(line, LegBegun)}
    ended = {(line.receiver, line.number): line for line in lines if isinstance(line, LegEnded)}
    records = world.executor.records
    assert begun.keys() == ended.keys()
    assert set(begun) == {(name, 1 + k) for name, record in records.items() for k in range(len(record.legs))}
    for (name, number), line in begun.items():
        leg = records[name].legs[number - 1].leg
        assert (line.guide, line.direction, line.stop_reference) == (leg.guide, leg.direction, leg.stop_reference)
        assert line.stop_angle_rad == leg.stop_angle_rad
        assert complex(*line.start_m) == leg.start
        assert complex(*line.end_m) == leg.end
        assert line.band_m > 0.0
        assert line.time_ns < ended[name, number].time_ns
        assert ended[name, number].stop_angle_error_rad == records[name].legs[number - 1].stop_angle_error_rad


def test_samples_hold_what_was_measured_and_where_the_vehicle_told_it_was(
    flown: tuple[World, list[SeriesLine]],
) -> None:
    world, lines = flown
    ticks = [line for line in lines if isinstance(line, Tick)]
    times_ns = [tick.time_ns for tick in ticks]
    assert times_ns == sorted(times_ns)
    assert len(ticks) > 5 * 60
    for name, record in world.executor.records.items():
        assert record.state is ReceiverState.PLACED
        samples = [tick.receivers[name] for tick in ticks if name in tick.receivers]
        assert {"LOCATING", "LEG_1", "VERIFYING"} <= {sample.state for sample in samples}
        last = [sample for sample in samples if sample.angle_rad is not None][-1]
        assert last.angle_rad == pytest.approx(record.legs[-1].leg.stop_angle_rad, abs=math.radians(2.0))
        assert last.at_m is not None
        assert abs(complex(*last.at_m) - record.route.target) < 1.5
        assert last.remaining_m == pytest.approx(0.0, abs=0.7)
        assert last.nearest_m is not None
        assert last.nearest_m >= 5.0


def test_transmitters_are_switched_on_and_off_in_turn(flown: tuple[World, list[SeriesLine]]) -> None:
    _, lines = flown
    on: set[str] = set()
    switched = Counter[bool]()
    for line in lines:
        if isinstance(line, Switched):
            assert (line.transmitter in on) is not line.on
            (on.add if line.on else on.discard)(line.transmitter)
            switched[line.on] += 1
    assert on == set()
    assert switched[True] == switched[False] >= 9


def test_a_leg_flown_again_after_a_hold_is_a_leg_of_its_own(tmp_path: Path) -> None:
    world = World()
    record = world.executor.records["U1"]
    leg = record.route.legs[0]
    with open_lines(tmp_path / "series.jsonl", synced=False) as lines:
        series = Series(
            lines, RunStatus("x", world.clock, records={"U1": record}), PositionBoard(), world.frame, world.clock
        )
        record.state = ReceiverState.LEG_1
        for _ in range(2):
            record.legs.append(LegRecord(leg, started_s=world.clock.now_s()))
            series.sample()
            series.sample()
            record.legs.clear()
    kinds = [type(line).__name__ for line in lines_of(tmp_path / "series.jsonl")]
    assert kinds == ["LegBegun", "Tick", "Tick", "LegBegun", "Tick", "Tick"]


async def test_what_is_no_number_is_left_out_and_nothing_is_raised(tmp_path: Path) -> None:
    world, board, bus = World(), PositionBoard(), FakeBus()
    record = world.executor.records["U1"]
    record.state = ReceiverState.LOCATING
    board.latest["U1"] = SitePosition(0.0, complex(math.nan, math.inf), 20.0)
    with open_lines(tmp_path / "series.jsonl", synced=False) as lines:
        status = RunStatus("x", world.clock, records={"U1": record})
        series = Series(lines, status, board, world.frame, world.clock)
        series.attach(bus, world.keys)
        bus.put_reliably(world.keys.emission("L0"), b"{]")
        bus.put_reliably(world.keys.emission("L0"), encode(Emission(on=True)))
        series.sample()
    switched, tick = lines_of(tmp_path / "series.jsonl")
    assert isinstance(switched, Switched)
    assert isinstance(tick, Tick)
    assert tick.receivers["U1"].at_m is None


async def test_a_defect_ends_the_series_loudly_and_not_the_flight(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    world = World()
    with open_lines(tmp_path / "series.jsonl", synced=False) as lines:
        status = RunStatus("x", world.clock, records={"U1": None})  # type: ignore[dict-item]
        task = asyncio.create_task(Series(lines, status, PositionBoard(), world.frame, world.clock).record())
        await settle()
        assert task.done()
        assert task.exception() is None
    assert "the flight goes on" in caplog.text


def test_a_line_of_another_kind_is_refused() -> None:
    with pytest.raises(msgspec.MsgspecError):
        read_line(b'{"kind": "poem"}')
