"""A recording is read back as it was written; where it is cut or damaged that is said, and nothing is made up."""

from __future__ import annotations

import random
from pathlib import Path

import pytest

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Bearing, BearingReport, encode
from gcs.errors import ServiceError
from gcs.recording.mcap_file import McapFiles, SizeLimits
from gcs.recording.mcap_reading import Recorded, read_flight

KEY = SwarmKeys("test").bearings("U1")
COUNT = 150


def write(folder: Path, limits: SizeLimits | None = None) -> list[Recorded]:
    """Record and return what was recorded: a chunk a second."""
    files = McapFiles(folder, {}, limits or SizeLimits(), free_bytes=lambda _: 10**12)
    noise = random.Random(1)
    said = []
    for number in range(COUNT):
        report = BearingReport(number, number, "true_north", [Bearing("L0", noise.uniform(-3.0, 3.0), 0.002)])
        said.append(Recorded(KEY, number * 10**8, encode(report)))
        files.write(KEY, BearingReport, said[-1].time_ns, said[-1].payload)
    files.finish()
    return said


def read(folder: Path) -> tuple[list[Recorded], list[str]]:
    complaints: list[str] = []
    return list(read_flight(folder, complaints.append)), complaints


def test_it_comes_back_to_the_last_bit_and_in_order(tmp_path: Path) -> None:
    said = write(tmp_path)
    assert read(tmp_path) == (said, [])


def test_parts_are_one_recording(tmp_path: Path) -> None:
    said = write(tmp_path, SizeLimits(part_bytes=1_000))
    assert (tmp_path / "flight-4.mcap").exists()
    assert read(tmp_path) == (said, [])


def test_a_part_that_is_gone_is_missed(tmp_path: Path) -> None:
    said = write(tmp_path, SizeLimits(part_bytes=3_000))
    (tmp_path / "flight-2.mcap").unlink()
    found, complaints = read(tmp_path)
    assert found == said[: len(found)]
    assert complaints == ["a part of the recording is missing before flight-3.mcap"]


def test_whatever_a_file_is_cut_to_what_is_whole_is_read_and_the_rest_is_said(tmp_path: Path) -> None:
    said, path = write(tmp_path), tmp_path / "flight.mcap"
    whole = path.read_bytes()
    lengths = random.Random(1)
    most = 0
    for length in {0, 1, 7, 8, len(whole) - 1, *(lengths.randrange(len(whole)) for _ in range(80))}:
        path.write_bytes(whole[:length])
        found, complaints = read(tmp_path)
        assert found == said[: len(found)]
        (complaint,) = complaints
        assert f"after {len(found)} messages" in complaint
        assert "mcap recover" in complaint
        most = max(most, len(found))
    assert most > COUNT / 2


def test_a_damaged_byte_is_never_taken_for_a_message(tmp_path: Path) -> None:
    """A flipped bit shows by the chunk's checksum, or leads the reader astray: in any words, but no traceback."""
    said, path = write(tmp_path), tmp_path / "flight.mcap"
    whole = path.read_bytes()
    places = random.Random(2)
    unharmed = 0
    for _ in range(200):
        damaged = bytearray(whole)
        damaged[places.randrange(8, len(whole))] ^= 1 << places.randrange(8)
        path.write_bytes(damaged)
        found, complaints = read(tmp_path)
        assert complaints or found == said
        assert all(message in said for message in found)
        unharmed += not complaints
    assert 0 < unharmed < 150  # an index, say, which is not needed here


@pytest.mark.parametrize("content", [b"PK\x03\x04 a zip file, say", b"{}" * 100])
def test_another_kind_of_file_is_named(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "flight.mcap").write_bytes(content)
    with pytest.raises(ServiceError, match=r"flight\.mcap is no MCAP file"):
        read(tmp_path)


def test_a_folder_without_a_recording_is_no_run(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match=r"holds no flight\.mcap"):
        read(tmp_path)
    with pytest.raises(ServiceError, match="cannot be read"):
        read(tmp_path / "gone")
