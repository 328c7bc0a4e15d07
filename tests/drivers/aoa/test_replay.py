"""A replayed sensor: the recorded bearings at their own pace, captured anew."""

import asyncio

import pytest

from drivers.aoa.kinds import read_settings
from drivers.aoa.replay import Replay, ReplaySettings
from drivers.bus.messages import Bearing, BearingReport, encode
from drivers.errors import SensorError
from tests.fakes import ManualClock, settle

RECORDED_NS = 1_700_000_000_000_000_000


def recorded(offset_s, azimuth_rad, sequence=40):
    report = BearingReport(
        RECORDED_NS + round(offset_s * 1e9), sequence, "true_north", [Bearing("L0", azimuth_rad, 0.01)]
    )
    return encode(report)


@pytest.fixture
def replayed(tmp_path):
    """Return what replays lines; its reports come with the time at which they did, s."""
    path = tmp_path / "reports.jsonl"

    async def replay(lines, duration_s, *, repeat=False):
        path.write_bytes(b"\n".join(lines))
        clock, came, said = ManualClock(), [], []
        started_s = clock.now_s()
        sensor = Replay(ReplaySettings(path=str(path), repeat=repeat), clock)
        task = asyncio.create_task(
            sensor.run(lambda r: came.append((round(clock.now_s() - started_s, 6), r, clock.unix_ns())), said.append)
        )
        await settle()
        await clock.advance(duration_s)
        done = task.done()
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)
        if done and not task.cancelled() and task.exception():
            raise task.exception()
        return came, said, dict(sensor.counts), done

    return replay


async def test_reports_come_at_their_own_pace_and_are_captured_anew(replayed):
    came, said, counts, done = await replayed([recorded(0.0, 0.1), recorded(0.1, 0.2), recorded(0.35, 0.3)], 1.0)
    assert [(at_s, report.bearings[0].azimuth_rad) for at_s, report, _ in came] == [(0.0, 0.1), (0.1, 0.2), (0.35, 0.3)]
    assert all(report.captured_ns == now_ns for _, report, now_ns in came)
    assert [report.sequence for _, report, _ in came] == [1, 2, 3]
    assert (counts, done) == ({}, True)
    assert said[0].endswith("replayed 3 reports")


async def test_it_replays_again_and_again_when_asked_to_and_sequences_go_on(replayed):
    came, _, _, done = await replayed([recorded(0.0, 0.1), recorded(0.5, 0.2)], 1.4, repeat=True)
    assert not done
    assert [at_s for at_s, _, _ in came] == [0.0, 0.5, 0.6, 1.1, 1.2]
    assert [report.sequence for _, report, _ in came] == [1, 2, 3, 4, 5]


async def test_lines_that_are_no_reports_and_those_out_of_order_are_counted(replayed):
    lines = [
        recorded(0.0, 0.1),
        b"",
        b"{",
        b'{"captured_ns":1}',
        recorded(0.2, 0.2),
        recorded(0.1, 0.3),
        recorded(0.2, 0.4),
    ]
    came, _, counts, done = await replayed(lines, 1.0)
    assert [report.bearings[0].azimuth_rad for _, report, _ in came] == [0.1, 0.2]
    assert counts == {"malformed": 2, "out_of_order": 2}
    assert done


@pytest.mark.parametrize("lines", [[], [b"nonsense"], [b""]])
@pytest.mark.parametrize("repeat", [False, True])
async def test_a_file_without_any_report_is_an_error(replayed, lines, repeat):
    with pytest.raises(SensorError, match="holds no bearing report"):
        await replayed(lines, 1.0, repeat=repeat)


async def test_a_file_that_is_not_there_is_an_error(tmp_path):
    sensor = read_settings("replay", {"path": str(tmp_path / "none.jsonl")}).open(ManualClock())
    with pytest.raises(SensorError, match="cannot be replayed"):
        await sensor.run(lambda _: None, lambda _: None)
