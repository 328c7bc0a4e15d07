"""The recording of a flight: everything said on the bus and decided by stop monitors, written off the event loop.

A handler on the event loop only appends to what waits, which is bounded; one thread looks there from time to time,
checks, counts and writes. It is not woken for every message: that would take the event loop from the flight each time.
Whatever becomes of the files, the counting goes on and so does the flight.
"""

from __future__ import annotations

import asyncio
import contextlib
import logging
import threading
from collections import deque
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any, Final

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import MalformedMessageError, encode
from drivers.bus.session import Bus
from drivers.clock import Clock
from gcs.errors import ServiceError
from gcs.recording.mcap_file import McapFiles, RecordingFullError, SizeLimits
from gcs.recording.mcap_reading import parts_of
from gcs.recording.run_folder import replace_json
from gcs.recording.topics import Unreadable, decoded, every_message, message_on, monitor_topic, monitored
from gcs.recording.traffic import Traffic
from gcs.recording.versions import versions
from gcs.traced_monitor import MonitorNote

log = logging.getLogger(__name__)

QUEUE_LENGTH: Final = 20_000
QUEUE_BYTES: Final = 64 * 2**20
MOST_KEYS: Final = 10_000
"""What comes on further keys is recorded as on one: a stranger may invent keys without end."""
_FURTHER: Final = "further"
_LOOKS_S: Final = 0.02
_SETTLES_S: Final = 0.06
"""When nothing has come for so long, all that came is put into the file: a service that is killed later loses none."""
_CLOSING_S: Final = 10.0
"""A disk that takes longer than this to finish the file is not waited for."""

Say = Callable[[str], None]
"""Puts a message before the operator, on the event loop."""


class Recording:
    """One flight's recording. `note` is called on the event loop."""

    def __init__(self, files: McapFiles, clock: Clock, say: Say, queue_length: int = QUEUE_LENGTH) -> None:
        self.dropped = 0
        self.stopped: str | None = None
        """Why nothing is written any more, or None."""
        self.traffic = Traffic()
        self._files = files
        self._clock = clock
        self._say = say
        self._ended = False
        self._opened_ns, self._opened_s = clock.unix_ns(), clock.now_s()
        self._queue_length = queue_length
        self._waiting: deque[tuple[int, str, bytes]] = deque()
        self._noted_bytes = self._taken_bytes = 0  # each counted by one thread only
        self._wrote_s = self._opened_s
        self._ending = threading.Event()

    def note(self, key: str, payload: bytes) -> None:
        """Record one message as it is now; dropped and counted when the disk does not keep up."""
        if self._ended:
            return
        time_ns = self._opened_ns + round((self._clock.now_s() - self._opened_s) * 1e9)
        waiting_bytes = self._noted_bytes - self._taken_bytes
        if len(self._waiting) < self._queue_length and waiting_bytes + len(payload) <= QUEUE_BYTES:
            self._noted_bytes += len(payload)
            self._waiting.append((time_ns, key, payload))
            return
        if not self.dropped:
            self._say("the disk is too slow for flight.mcap: messages are missing in it; the flight goes on")
        self.dropped += 1

    def note_control(self, keys: SwarmKeys, request: bytes, reply: bytes) -> None:
        """Record a request to the relay and its answer, which no subscriber hears."""
        self.note(f"{keys.control}/request", request)
        self.note(f"{keys.control}/reply", reply)

    def note_monitor(self, receiver: str, note: MonitorNote) -> None:
        """Record what a stop monitor was told or answered, which never was on the bus."""
        self.note(monitor_topic(receiver), encode(note))

    def figures(self) -> dict[str, Any]:
        """Return traffic.json; to be asked for when the thread has ended."""
        return {
            "files": [path.name for path in parts_of(self._files.folder)],
            "dropped": self.dropped,
            "stopped": self.stopped,
            **self.traffic.figures(),
        }

    def write_all(self, tell: Say) -> None:
        """Write what is noted until `end`; runs in a thread of its own, and `tell` is called there."""
        while not self._ending.wait(_LOOKS_S):
            self.look(tell)
        self._write_waiting(tell)
        try:
            self._files.finish()
        except Exception as error:  # noqa: BLE001 - as above
            self._stop(error, tell)

    def look(self, tell: Say) -> None:
        """Write what waits, and where nothing does any more have all of it in the file."""
        now_s = self._clock.now_s()
        if self._waiting:
            self._wrote_s = now_s
            self._write_waiting(tell)
        elif self.stopped is None and now_s - self._wrote_s >= _SETTLES_S:
            try:
                self._files.settle()
            except Exception as error:  # noqa: BLE001 - whatever is wrong with a recording must not end a flight
                self._stop(error, tell)

    def end(self) -> None:
        """Let the thread end when it has written what waits."""
        self._ended = True
        self._ending.set()

    def _write_waiting(self, tell: Say) -> None:
        while self._waiting:
            item = self._waiting.popleft()
            self._taken_bytes += len(item[2])
            try:
                self._write(*item)
            except Exception as error:  # noqa: BLE001 - whatever is wrong with a recording must not end a flight
                self._stop(error, tell)

    def _write(self, time_ns: int, key: str, payload: bytes) -> None:
        if monitored(key) is None and key not in self.traffic.keys and len(self.traffic.keys) >= MOST_KEYS:
            key = _FURTHER
        problem: str | None = None
        message: Any = None
        try:
            message = decoded(payload, key)
        except MalformedMessageError as error:
            problem = str(error)
        if monitored(key) is None:
            self.traffic.count(key, time_ns, len(payload), message, readable=problem is None)
        if self.stopped is None and problem is None:
            self._files.write(key, message_on(key), time_ns, payload)
        elif self.stopped is None:
            unreadable = Unreadable(problem or "", payload)
            self._files.write(f"{key}/unreadable", Unreadable, time_ns, encode(unreadable))

    def _stop(self, error: Exception, tell: Say) -> None:
        if self.stopped is None:
            self.stopped = str(error)
            tell(f"flight.mcap: {error}: recording has stopped, the flight goes on")
        if not isinstance(error, RecordingFullError):
            self._files.give_up()


@contextlib.asynccontextmanager
async def open_recording(
    folder: Path, bus: Bus, keys: SwarmKeys, clock: Clock, say: Say, limits: SizeLimits | None = None
) -> AsyncIterator[Recording]:
    """Record everything said in a swarm into the folder while the block lasts; then write traffic.json there.

    What this process publishes comes back over the bus, so that every message is seen once. Nothing that goes wrong is
    raised: `say` is told, on the event loop.
    """
    loop = asyncio.get_running_loop()

    def tell(message: str) -> None:
        log.error("%s", message)
        with contextlib.suppress(RuntimeError):  # the loop may have closed while the disk hung
            loop.call_soon_threadsafe(say, message)

    files = McapFiles(folder, {"swarm": keys.swarm, **versions()}, limits or SizeLimits())
    recording = Recording(files, clock, say)
    thread = threading.Thread(target=recording.write_all, args=[tell], name="recording", daemon=True)
    thread.start()
    bus.subscribe(every_message(keys), recording.note)
    try:
        yield recording
    finally:
        await asyncio.to_thread(_close, folder, recording, thread, tell)


def _close(folder: Path, recording: Recording, thread: threading.Thread, tell: Say) -> None:
    recording.end()
    thread.join(_CLOSING_S)
    if thread.is_alive():
        tell(f"{folder}: the disk does not answer: the recording may not be complete")
        return
    try:
        replace_json(folder / "traffic.json", recording.figures())
    except ServiceError as error:
        tell(str(error))
