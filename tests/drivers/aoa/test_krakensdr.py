"""The KrakenSDR: what its software serves becomes bearings, or is counted and dropped.

The golden files follow the format that the KrakenSDR documentation describes under "Kraken App output format" (wiki of
github.com/krakenrf/krakensdr_docs, and the method that writes DOA_value.html in github.com/krakenrf/krakensdr_doa,
kraken_sdr_signal_processor.py). Both show one situation: L0 is 45 degrees to the right of the nose, L1 120 degrees to
its left. In one, directions are clockwise from the nose; in the other they are on the unit circle, 0 to the right.
"""

import asyncio
import contextlib
import json
import math
from pathlib import Path

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.aoa.http_text import HttpAddress, fetch_text
from drivers.aoa.kinds import read_settings
from drivers.aoa.kraken_csv import FIELDS, MalformedLineError, read_line
from drivers.aoa.krakensdr import FROZEN_AFTER, KrakenReader, KrakenSensor, KrakenSettings
from drivers.bus.messages import BearingReport, decode, encode
from drivers.clock import SystemClock
from drivers.errors import SensorError
from tests.fakes import ManualClock

GOLDEN = Path(__file__).parent / "golden"
COMPASS = (GOLDEN / "kraken_compass.csv").read_text()
UNIT_CIRCLE = (GOLDEN / "kraken_unit_circle.csv").read_text()
TIME_MS = 1_790_000_000_437
NOW_MS = TIME_MS + 100
PATIENCE_S = 20.0
CHANNELS = {"L0": 433.92, "L1": 434.2}
SETTINGS = KrakenSettings(transmitters_mhz=CHANNELS, direction="clockwise", zero_deg=0.0, heading="none")


def with_settings(**changes):
    return msgspec.structs.replace(SETTINGS, **changes)


def line(number=0, **fields):
    """Return a line of the compass file with fields (by their number, as f2=...) replaced."""
    cells = COMPASS.splitlines()[number].split(",")
    for name, value in fields.items():
        cells[int(name[1:]) - 1] = f" {value}"
    return ",".join(cells)


def azimuths_deg(report):
    return {bearing.transmitter: math.degrees(bearing.azimuth_rad) for bearing in report.bearings}


def read(text, **changes):
    """Return the reports in a text, and what was counted."""
    reader = KrakenReader(with_settings(**changes))
    return reader.reports(text, NOW_MS), dict(reader.counts)


@pytest.mark.parametrize(
    ("text", "direction", "zero_deg"),
    [(COMPASS, "clockwise", 0.0), (UNIT_CIRCLE, "counter_clockwise", 90.0)],
    ids=["compass", "unit circle"],
)
def test_both_conventions_give_the_golden_bearings(text, direction, zero_deg):
    (report,), counts = read(text, direction=direction, zero_deg=zero_deg)
    golden = decode((GOLDEN / "kraken_bearings.json").read_bytes(), BearingReport)
    assert azimuths_deg(report) == pytest.approx(azimuths_deg(golden))
    assert msgspec.structs.replace(report, bearings=[]) == msgspec.structs.replace(golden, bearings=[])
    assert {b.transmitter: b.sigma_rad for b in report.bearings} == {
        b.transmitter: b.sigma_rad for b in golden.bearings
    }
    assert counts == {}


def test_the_golden_files_have_the_documented_fields():
    for text in (COMPASS, UNIT_CIRCLE):
        for one in text.splitlines():
            assert len(one.split(",")) == FIELDS == 377
    first = read_line(COMPASS.splitlines()[0])
    assert (first.time_ms, first.frequency_hz, first.latency_ms) == (TIME_MS, 433_920_000, 437)
    assert (first.direction_deg, first.gps_heading_deg, first.compass_heading_deg) == (45.0, 40.5, 38.25)


def test_the_wrong_convention_is_not_the_right_one():
    (report,), _ = read(UNIT_CIRCLE, direction="clockwise", zero_deg=0.0)
    assert azimuths_deg(report) == pytest.approx({"L0": 45.0, "L1": 210.0})


@pytest.mark.parametrize(
    ("changes", "l0_deg"),
    [
        ({"heading": "gps"}, 45.0 + 40.5),
        ({"heading": "compass"}, 45.0 + 38.25),
        ({"heading": "compass", "declination_deg": 11.5}, 45.0 + 38.25 + 11.5),
        ({"heading": "main"}, 45.0 + 38.25),
        ({"heading": "main", "declination_deg": 11.5}, 45.0 + 38.25 + 11.5),
        ({"heading": "gps", "declination_deg": 11.5}, 45.0 + 40.5),
        ({"heading": "fixed", "fixed_heading_deg": -100.0}, 45.0 - 100.0 + 360.0),
        ({"heading": "gps", "zero_deg": -90.0}, 45.0 + 40.5 - 90.0 + 360.0),
    ],
)
def test_a_heading_makes_true_bearings(changes, l0_deg):
    (report,), _ = read(COMPASS, **changes)
    assert report.reference == "true_north"
    assert azimuths_deg(report)["L0"] == pytest.approx(l0_deg)


def test_the_main_heading_is_the_one_that_the_line_names():
    (report,), _ = read(line(f13="GPS"), heading="main", declination_deg=11.5)
    assert azimuths_deg(report)["L0"] == pytest.approx(45.0 + 40.5)


def test_relative_to_the_nose_no_heading_counts():
    (report,), _ = read(COMPASS, heading="none", fixed_heading_deg=90.0, declination_deg=11.5)
    assert report.reference == "body"
    assert azimuths_deg(report)["L0"] == pytest.approx(45.0)


@pytest.mark.parametrize("fields", [{"f9": "0.0"}, {"f10": "0.0"}])
def test_on_the_equator_or_at_greenwich_a_heading_counts_too(fields):
    (report,), _ = read(line(**fields), heading="gps")
    assert azimuths_deg(report)["L0"] == pytest.approx(45.0 + 40.5)


@pytest.mark.parametrize(
    "fields",
    [
        {"f11": "None", "f12": ""},
        {"f9": "0.0", "f10": "0.0"},
        {"f11": "nan", "f12": "inf"},
        {"f11": "361", "f12": "-361"},
    ],
)
@pytest.mark.parametrize("heading", ["gps", "compass", "main"])
def test_without_the_heading_it_needs_a_line_gives_no_bearing(fields, heading):
    reports, counts = read(line(**fields), heading=heading)
    assert (reports, counts) == ([], {"without_heading": 1})


@pytest.mark.parametrize(
    ("confidence", "sigma_deg"), [(1.99, None), (2.0, 12.0), (4.99, 12.0), (5.0, 6.0), (10.0, 3.0), (25.5, 3.0)]
)
def test_the_confidence_says_how_good_a_bearing_is(confidence, sigma_deg):
    reports, counts = read(line(f3=confidence))
    if sigma_deg is None:
        assert (reports, counts) == ([], {"weak": 1})
    else:
        assert reports[0].bearings[0].sigma_rad == pytest.approx(math.radians(sigma_deg))


def test_a_channel_is_its_transmitter_within_the_tolerance_only():
    for frequency_hz, name in ((433_920_000 + 12_500, "L0"), (433_920_000 - 12_500, "L0"), (434_200_001, "L1")):
        (report,), _ = read(line(f5=frequency_hz))
        assert azimuths_deg(report).keys() == {name}
    reports, counts = read(line(f5=433_920_000 + 12_501))
    assert (reports, counts) == ([], {"unknown_frequency": 1})


def test_of_two_channels_on_one_transmitter_the_more_confident_counts():
    for text in (
        line(f3=6.0, f2=10.0) + "\n" + line(f3=8.0, f2=20.0),
        line(f3=8.0, f2=20.0) + "\n" + line(f3=6.0, f2=10.0),
    ):
        (report,), _ = read(text)
        assert azimuths_deg(report) == {"L0": pytest.approx(20.0)}


def test_the_capture_is_the_middle_of_the_frame_and_as_uncertain_as_half_of_it():
    (report,), _ = read(line(f7=500))
    assert report.captured_ns == (TIME_MS - 250) * 1_000_000
    assert report.captured_uncertainty_ns == 250_000_000


@pytest.mark.parametrize("latencies_ms", [(500, 100), (100, 500)])
def test_a_frame_took_as_long_as_its_slowest_channel(latencies_ms):
    (report,), _ = read("\n".join(line(number, f7=took_ms) for number, took_ms in enumerate(latencies_ms)))
    assert report.captured_ns == (TIME_MS - 250) * 1_000_000
    assert report.captured_uncertainty_ns == 250_000_000


def test_whole_degrees_are_admitted_and_finer_ones_too():
    assert read(line(f2="360"))[0][0].resolution_rad == pytest.approx(math.radians(1.0))
    assert read(line(f2="211.375"))[0][0].resolution_rad == 0.0
    for directions_deg in (("211.375", "240"), ("211", "240.5")):
        (report,), _ = read("\n".join(line(number, f2=deg) for number, deg in enumerate(directions_deg)))
        assert report.resolution_rad == 0.0


@pytest.mark.parametrize(
    ("age_ms", "problem"), [(2001, "stale"), (-501, "from_the_future"), (1999, None), (-499, None)]
)
def test_a_frame_is_fresh_by_the_clock_of_this_computer(age_ms, problem):
    reader = KrakenReader(SETTINGS)
    reports = reader.reports(COMPASS, TIME_MS + age_ms)
    assert len(reports) == (0 if problem else 1)
    assert dict(reader.counts) == ({problem: 2} if problem else {})


def test_a_frame_from_the_future_does_not_hide_those_of_now():
    reader = KrakenReader(SETTINGS)
    assert reader.reports(line(f1=NOW_MS + 3600_000), NOW_MS) == []
    assert len(reader.reports(COMPASS, NOW_MS)) == 1


def test_a_frame_gives_one_report_however_often_it_is_polled():
    reader = KrakenReader(SETTINGS)
    assert len(reader.reports(COMPASS, NOW_MS)) == 1
    assert reader.reports(COMPASS, NOW_MS) == []
    later = line(f1=TIME_MS + 500, f3=11.0) + "\n" + line(1, f1=TIME_MS + 437, f3=7.0)
    reports = reader.reports(later, NOW_MS + 500)
    assert [report.captured_ns // 1_000_000 for report in reports] == [TIME_MS + 437 - 219, TIME_MS + 500 - 219]
    assert [report.sequence for report in reports] == [2, 3]
    assert reader.reports(later, NOW_MS + 600) == []


def test_a_radio_that_repeats_its_measurement_to_the_last_digit_is_frozen():
    reader = KrakenReader(SETTINGS)
    assert len(reader.reports(line(f1=TIME_MS - 1, f18="0.5"), NOW_MS)) == 1
    made = [len(reader.reports(line(f1=TIME_MS + k), NOW_MS)) for k in range(6)]
    assert made == [1] * (FROZEN_AFTER - 1) + [0] * (6 - FROZEN_AFTER + 1)
    assert reader.counts["frozen"] == 6 - FROZEN_AFTER + 1
    assert len(reader.reports(line(f1=TIME_MS + 9, f18="0.37"), NOW_MS)) == 1


def test_a_radio_with_two_channels_on_one_transmitter_is_found_frozen_too():
    reader = KrakenReader(SETTINGS)
    texts = ["\n".join((line(f1=TIME_MS + k), line(f1=TIME_MS + k, f3=8.0))) for k in range(6)]
    assert [len(reader.reports(text, NOW_MS)) for text in texts] == [1] * (FROZEN_AFTER - 1) + [0] * (
        6 - FROZEN_AFTER + 1
    )


@pytest.mark.parametrize(
    "text",
    [
        "no CSV at all",
        "<html><body>404</body></html>",
        line().rsplit(",", 1)[0],
        line() + ", 1.0",
        line(f1="1790000000"),
        line(f1="17900000004.5e99"),
        line(f2="-1"),
        line(f2="360.5"),
        line(f2="nan"),
        line(f2="4_5"),
        line(f2="٤٥"),
        line(f2=""),
        line(f3="inf"),
        line(f3="-0.5"),
        line(f5="0"),
        line(f7="-1"),
        line(f7="1e9"),
        line(f8="my, station"),
        line(f200="R"),
        line(f377=""),
    ],
)
def test_a_line_that_is_not_of_the_format_is_counted_and_costs_only_itself(text):
    with pytest.raises(MalformedLineError):
        read_line(text)
    (report,), counts = read(f"{text}\n\n{line(1)}\n")
    assert azimuths_deg(report).keys() == {"L1"}
    assert counts == {"malformed": 1}


@given(st.text(max_size=300))
def test_no_text_breaks_the_reader(text):
    reports, _ = read(text)
    assert reports == []


@given(st.lists(st.tuples(st.integers(1, FIELDS), st.text(max_size=8) | st.floats().map(str) | st.integers().map(str))))
def test_a_line_with_any_fields_replaced_is_dropped_or_gives_a_valid_report(replaced):
    reports, counts = read(line(**{f"f{number}": value for number, value in replaced}), heading="gps")
    for report in reports:
        assert decode(encode(report), BearingReport) == report
    assert len(reports) + sum(counts.values()) >= 1


@given(st.integers(0, len(COMPASS)), st.integers(0, len(COMPASS)))
def test_a_file_read_while_it_is_written_gives_no_invented_bearing(cut, join):
    """The old file's end may follow the new file's beginning: every direction still is one that stands in a file."""
    reports, _ = read(COMPASS[:cut] + UNIT_CIRCLE[join:])
    for report in reports:
        assert {round(deg) for deg in azimuths_deg(report).values()} <= {45, 240, 210}


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({}, "transmitters_mhz"),
        ({"transmitters_mhz": {}}, "$.transmitters_mhz"),
        ({"transmitters_mhz": {"L0": -1.0}}, "$.transmitters_mhz"),
        ({"direction": "left"}, "$.direction"),
        ({"zero_deg": 400}, "$.zero_deg"),
        ({"colour": 1}, "colour"),
        ({"url": "ftp://x/"}, "http://HOST:PORT/PATH"),
        ({"url": "http://x:99999/"}, "ort"),
        ({"transmitters_mhz": {"L0": 433.92, "L1": 433.944}}, "tolerance_khz"),
        ({"sigma": [{"confidence_db": 5, "sigma_deg": 3}, {"confidence_db": 2, "sigma_deg": 6}]}, "rising"),
    ],
)
def test_settings_that_cannot_be_meant_are_refused_with_their_name(values, says):
    good = {"transmitters_mhz": CHANNELS, "direction": "clockwise", "zero_deg": 0, "heading": "none"}
    assert read_settings("krakensdr", good) == SETTINGS
    with pytest.raises(SensorError) as caught:
        read_settings("krakensdr", (good if values else {}) | values)
    assert says in str(caught.value)


def test_channels_may_stand_in_any_order_as_long_as_their_tolerances_do_not_meet():
    channels = {"L0": 433.946, "L1": 433.92}
    values = {"transmitters_mhz": channels, "direction": "clockwise", "zero_deg": 0, "heading": "none"}
    assert read_settings("krakensdr", values) == with_settings(transmitters_mhz=channels)


class Server:
    """An HTTP server on loopback that answers each request as it is told."""

    def __init__(self):
        self.answer = ok("")
        self.requests = []
        self._server = None

    async def __aenter__(self):
        await self.listen(0)
        return self

    async def listen(self, port):
        self._server = await asyncio.start_server(self._serve, "127.0.0.1", port)
        self.port = self._server.sockets[0].getsockname()[1]

    async def close(self):
        self._server.close()

    async def __aexit__(self, *_):
        await self.close()

    @property
    def url(self):
        return f"http://127.0.0.1:{self.port}/DOA_value.html"

    async def _serve(self, reader, writer):
        with contextlib.suppress(ConnectionError, asyncio.IncompleteReadError):
            self.requests.append(await reader.readuntil(b"\r\n\r\n"))
            if self.answer is None:
                await reader.read()  # until the other side gives up
            else:
                writer.write(self.answer)
                await writer.drain()
        writer.transport.abort() if self.answer is None else writer.close()


def ok(text, length=None):
    body = text.encode()
    return f"HTTP/1.1 200 OK\r\nContent-Length: {len(body) if length is None else length}\r\n\r\n".encode() + body


@pytest.fixture
async def server():
    async with Server() as server:
        yield server


async def test_a_text_is_fetched_as_it_is_served(server):
    server.answer = ok(COMPASS)
    address = HttpAddress.parse(server.url)
    assert await fetch_text(address, PATIENCE_S, 1_000_000) == COMPASS
    assert server.requests[0].startswith(b"GET /DOA_value.html HTTP/1.0\r\nHost: 127.0.0.1:")
    for answer, text in (
        (b"HTTP/1.0 200 OK\r\n\r\nuntil the end", "until the end"),
        (b"HTTP/1.0 200 OK\r\nContent-Length: 4\r\n\r\nfour and more", "four"),
        (b"HTTP/1.0 200 OK\r\n\r\n4\xff", "4\ufffd"),
    ):
        server.answer = answer
        assert await fetch_text(address, PATIENCE_S, 1_000_000) == text


@pytest.mark.parametrize(
    ("answer", "says"),
    [
        (None, "does not answer within 0.2 s"),
        (b"", "cannot be read"),
        (b"HTTP/1.1 404 Not Found\r\n\r\n", "404 Not Found"),
        (b"SSH-2.0-OpenSSH\r\n\r\n", "SSH-2.0"),
        (b"HTTP/1.1 200 OK\r\n" + b"X: y\r\n" * 10_000, "cannot be read"),
        (ok("short", length=99), "5 of 99 bytes"),
        (ok("x", length="many"), "cannot be read"),
        (ok("x" * 5000), "more than 1000 bytes"),
    ],
)
async def test_what_is_no_answer_is_an_error_that_names_the_address(server, answer, says):
    server.answer = answer
    with pytest.raises(SensorError) as caught:
        await fetch_text(HttpAddress.parse(server.url), 0.2 if answer is None else PATIENCE_S, 1000)
    assert says in str(caught.value)
    assert server.url in str(caught.value)


async def test_where_nobody_listens_is_an_error():
    server = Server()
    await server.listen(0)
    await server.close()
    with pytest.raises(SensorError, match="cannot be read"):
        await fetch_text(HttpAddress.parse(server.url), PATIENCE_S, 1000)


class PollClock(ManualClock):
    """A manual clock that notes how long it was slept on."""

    def __init__(self):
        super().__init__(unix_ns=NOW_MS * 1_000_000)
        self.slept_s = []

    async def sleep(self, duration_s):
        self.slept_s.append(duration_s)
        await super().sleep(duration_s)


async def until(condition):
    """Return when real input has made a condition true."""
    async with asyncio.timeout(PATIENCE_S):
        while not condition():  # noqa: ASYNC110 - it waits for a socket, not for a task
            await asyncio.sleep(0.005)


class Polling:
    """A KrakenSensor at work on a clock that a test moves."""

    def __init__(self, url, **changes):
        self.clock = PollClock()
        self.sensor = KrakenSensor(with_settings(**{"url": url, "timeout_s": PATIENCE_S} | changes), self.clock)
        self.reports, self.said = [], []

    @contextlib.asynccontextmanager
    async def running(self):
        task = asyncio.create_task(self.sensor.run(self.reports.append, self.said.append))
        try:
            yield self
        finally:
            task.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await task

    async def polls(self, count):
        """Let it poll so many times: each poll ends with a sleep on the clock, which is then slept through."""
        for _ in range(count):
            await until(lambda: self.clock.sleeping)
            await self.clock.advance(self.clock.slept_s[-1])


async def test_it_polls_and_publishes_each_frame_once(server):
    server.answer = ok(COMPASS)
    async with Polling(server.url, max_age_s=1e6).running() as polling:
        await polling.polls(3)
        server.answer = ok(line(f1=TIME_MS + 500, f3=9.0))
        await polling.polls(3)
    assert [sorted(azimuths_deg(report)) for report in polling.reports] == [["L0", "L1"], ["L0"]]
    assert polling.said == []
    assert set(polling.clock.slept_s) == {0.1}


async def test_a_radio_that_is_away_is_asked_less_often_and_missed_once(server):
    polling = Polling(server.url, max_age_s=1e6)
    await server.close()
    async with polling.running():
        await polling.polls(5)
        await until(lambda: polling.clock.sleeping)
        assert polling.clock.slept_s == [0.5, 1.0, 2.0, 4.0, 5.0, 5.0]
        assert polling.sensor.counts["no_answer"] == 6
        assert len(polling.said) == 1
        assert "trying again" in polling.said[0]
        server.answer = ok(COMPASS)
        await server.listen(server.port)
        await polling.polls(4)
        assert len(polling.reports) == 1
        assert polling.said[1:] == [f"{server.url} answers again"]
        await until(lambda: polling.clock.sleeping)
        await server.close()
        await polling.polls(1)
        await until(lambda: polling.clock.sleeping)
        assert polling.clock.slept_s[-1] == 0.5
        assert "trying again" in polling.said[2]


async def test_a_server_that_hangs_costs_its_time_out_and_no_more(server):
    server.answer = None
    async with Polling(server.url, max_age_s=1e6, timeout_s=0.3).running() as polling:
        await polling.polls(1)
        assert "does not answer within 0.3 s" in polling.said[0]
        server.answer = ok(COMPASS)
        async with asyncio.timeout(PATIENCE_S):
            while not polling.reports:
                await polling.polls(1)
    assert len(polling.reports) == 1


@pytest.mark.parametrize(
    ("text", "words", "polls"),
    [
        (line(f1=TIME_MS - 3600_000), "frames are old", 1),
        (line(f1=TIME_MS + 3600_000), "clock is ahead", 1),
        ("nonsense", "choose that data format", 12),
        (line(f5=999_000_000), "no transmitter has", 1),
        (line(f11="None"), "no heading of the kind", 1),
    ],
)
async def test_what_is_wrong_at_the_radio_is_said_once(server, text, words, polls):
    server.answer = ok(text)
    polling = Polling(server.url, heading="gps")
    async with polling.running():
        await polling.polls(polls + 3)
    assert len(polling.said) == 1
    assert words in polling.said[0]
    assert polling.reports == []


async def test_a_radio_that_repeats_itself_is_said_once(server):
    async with Polling(server.url).running() as polling:
        for number in range(10):
            server.answer = ok(line(f1=TIME_MS + number))
            await polling.polls(1)
    (said,) = polling.said
    assert "repeats one measurement" in said
    assert len(polling.reports) == FROZEN_AFTER - 1


async def test_a_torn_line_now_and_then_is_nothing_to_speak_of(server):
    server.answer = ok(COMPASS + "179000")
    async with Polling(server.url, max_age_s=1e6).running() as polling:
        await polling.polls(4)
    assert polling.said == []
    assert 4 <= polling.sensor.counts["malformed"] <= 5
    assert len(polling.reports) == 1


async def test_over_real_time_its_reports_are_as_old_as_the_frame(server):
    clock = SystemClock()
    now_ms = clock.unix_ns() // 1_000_000
    server.answer = ok(line(f1=now_ms, f7=100))
    reports = []
    settings = with_settings(url=server.url, timeout_s=PATIENCE_S, max_age_s=PATIENCE_S)
    task = asyncio.create_task(KrakenSensor(settings, clock).run(reports.append, print))
    await until(lambda: reports)
    task.cancel()
    assert reports[0].captured_ns == (now_ms - 50) * 1_000_000
    assert json.loads(encode(reports[0]))["captured_uncertainty_ns"] == 50_000_000
