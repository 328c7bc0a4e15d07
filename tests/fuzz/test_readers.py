"""The readers that are searched by coverage read their honest examples, and what is left of them."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.bus.messages import BearingReport, decode
from drivers.mavlink.codec import Codec, FrameSplitter
from gcs.recording.journal_reading import entries_of
from gcs.recording.mcap_reading import read_flight
from tests.fuzz.readers import READERS


@pytest.mark.parametrize("name", READERS)
def test_an_honest_example_and_every_part_of_it_is_read(name: str) -> None:
    example, read = READERS[name]
    honest = example()
    for length in {0, 1, len(honest) // 3, len(honest) // 2, len(honest) - 1, len(honest)}:
        read(honest[:length])
        read(honest[length:])


def test_the_examples_are_honest(tmp_path: Path) -> None:
    examples = {name: example() for name, (example, _) in READERS.items()}
    assert decode(examples["message"], BearingReport).sequence == 1
    (heartbeat,) = FrameSplitter().datagram(examples["mavlink"])
    assert Codec().accepts(heartbeat)
    assert len(entries_of(examples["journal"].splitlines()).entries) == 2
    (tmp_path / "flight.mcap").write_bytes(examples["recording"])
    assert len(list(read_flight(tmp_path, pytest.fail))) == 3
