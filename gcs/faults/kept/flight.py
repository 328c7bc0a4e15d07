"""The recording of everything said in a run, and what was said."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import encode
from drivers.bus.session import Bus
from drivers.clock import Clock
from gcs.faults.kept.missing import LOST_S, Missing
from gcs.recording.flight import Recording
from gcs.recording.mcap_file import McapFiles, SizeLimits
from gcs.recording.mcap_reading import parts_of, read_flight
from gcs.recording.topics import monitor_topic
from gcs.traced_monitor import MonitorNote

_LOST_S: Final = LOST_S + 0.1
"""The recorder looks less often than in life."""
_OUTRUN: Final = 10_000_000
"""So many messages may wait for the disk: virtual time waits for none."""


class _Files(McapFiles):
    """Files that stay as they are when their service is killed."""

    killed = False

    def finish(self) -> None:
        """Complete the file being written, if somebody is there to do it."""
        if not self.killed:
            super().finish()


class KeptFlight:
    """flight.mcap, written by the service's own recorder."""

    def __init__(self, folder: Path, clock: Clock, bus: Bus, keys: SwarmKeys) -> None:
        self._folder, self._clock = folder, clock
        self._complaints: list[str] = []
        self._files = _Files(folder, {"swarm": keys.swarm}, SizeLimits())
        self._recording = Recording(self._files, clock, self._complaints.append, queue_length=_OUTRUN)
        self._given: list[tuple[float, str, bytes]] = []
        every = (keys.every_bearings, keys.every_emission, keys.progress, keys.every_clock_ping, keys.every_clock_pong)
        for expression in every:
            bus.subscribe(expression, self._note)

    def traced(self, receiver: str, note: MonitorNote) -> None:
        """Record what a stop monitor was told or answered."""
        if not self._files.killed:
            self._given.append((self._clock.now_s(), monitor_topic(receiver), encode(note)))
            self._recording.note_monitor(receiver, note)

    def die(self) -> None:
        """Take nothing in any more: the service was killed."""
        self._files.killed = True

    def look(self) -> None:
        """Let the recorder look whether something waits."""
        if not self._files.killed:
            self._recording.look(self._complaints.append)

    def close(self, missing: Missing, killed_s: float) -> None:
        """Read it back: every message has to be there, in order, but those just before the service was killed."""
        self._recording.end()
        if not self._files.killed:
            self._recording.write_all(self._complaints.append)
        for complaint in self._complaints:
            missing("", complaint)
        read = read_flight(self._folder, lambda _: None) if parts_of(self._folder) else iter(())
        for at_s, topic, payload in self._given:
            found = next(read, None)
            if found is None and at_s >= killed_s - _LOST_S:
                break
            if found is None or (found.topic, found.payload) != (topic, payload):
                missing("", f"flight.mcap: what was said on {topic} at {at_s:.3f} s is not at its place")
                break
        self._files.give_up()

    def _note(self, key: str, payload: bytes) -> None:
        if not self._files.killed:
            self._given.append((self._clock.now_s(), key, payload))
            self._recording.note(key, payload)
