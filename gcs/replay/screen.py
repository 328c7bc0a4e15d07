"""A recorded run on the live screen: the status of the run, written by its recording instead of by the service."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

from rich.console import Console

from drivers.bus.keys import uav_of
from drivers.bus.messages import ControlReply, Emission, Progress
from drivers.clock import Clock
from drivers.tasks import background
from gcs.monitor.terminal import show_progress
from gcs.recording.topics import monitored
from gcs.relay.leg_flight import subtended
from gcs.relay.records import LegRecord
from gcs.relay.states import ReceiverState
from gcs.replay.monitors import MonitorReplay
from gcs.replay.run import RunReplay
from gcs.status import RunStatus
from gcs.traced_monitor import MonitorNote

_STATES: Final = {state.value: state for state in ReceiverState}


async def watch(replay: RunReplay, clock: Clock, console: Console) -> None:
    """Replay a run as fast as the clock goes, and show it. ServiceError when there is no recording."""
    screen = RecordedScreen(RunStatus(replay.name, clock, phase="replay", records=replay.records()), replay.monitors)
    messages = replay.messages()
    first = next(messages, None)
    if first is None:
        return
    first_ns, began_s = first[0].time_ns, clock.now_s()
    screen.status.started_s = began_s - replay.since_began_s(first_ns)
    async with background(show_progress(console, screen.status)):
        screen.take(first[0].topic, first[1])
        for message, said in messages:
            await clock.sleep(began_s + (message.time_ns - first_ns) * 1e-9 - clock.now_s())
            screen.take(message.topic, said)


@dataclass
class RecordedScreen:
    """Writes the status as the recorded messages have it; where receivers are is what the replayed monitors say."""

    status: RunStatus
    monitors: Mapping[str, MonitorReplay]

    def take(self, topic: str, said: object) -> None:
        """Take in a message that has been replayed."""
        match said:
            case Progress(receiver=receiver) if receiver in self.status.records:
                self._progress(said)
            case Emission(on=on):
                name = frozenset({uav_of(topic) or topic})
                self.status.on_air = self.status.on_air | name if on else self.status.on_air - name
            case ControlReply(message=message):
                self.status.say(f"to the operator: {message}")
            case MonitorNote():
                self._monitor(monitored(topic) or topic, said)

    def _progress(self, progress: Progress) -> None:
        record = self.status.records[progress.receiver]
        record.state = _STATES.get(progress.state, record.state)
        record.reason = progress.reason
        self.status.say(f"{record.name} {progress.state}" + (f": {progress.reason}" if progress.reason else ""))

    def _monitor(self, receiver: str, note: MonitorNote) -> None:
        if receiver not in self.status.records or receiver not in self.monitors:
            return
        legs, replayed = self.status.records[receiver].legs, self.monitors[receiver]
        if note.begun:
            legs.append(LegRecord(replayed.monitor.leg, note.time_s))
        if not legs:
            return
        if note.observed is not None:
            angle_rad = subtended(legs[-1].leg, note.observed.directions_rad)
            legs[-1].measured_angle_rad = legs[-1].measured_angle_rad if angle_rad is None else angle_rad
        if note.asked is not None and replayed.now is not None:
            legs[-1].estimate = replayed.monitor.estimate(replayed.now)
            legs[-1].ended_s = note.time_s if note.asked.arrived else None
