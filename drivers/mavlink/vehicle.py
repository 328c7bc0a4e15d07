"""One vehicle behind a link: its state as its telemetry tells it, and commands it acknowledges."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import VehicleError
from drivers.mavlink.codec import Message
from drivers.mavlink.link import Link, Subscription
from planner.frames import GeodeticPosition

ACK_TIMEOUT_S: Final = 3.0
_STATUS_TEXTS_KEPT: Final = 20


@dataclass(frozen=True)
class Heartbeat:
    """What the last heartbeat said, and when it came (this service's clock, s)."""

    time_s: float
    vehicle_type: int
    autopilot: int
    custom_mode: int
    armed: bool
    system_status: int


@dataclass(frozen=True)
class Kinematics:
    """Where the vehicle says it is and how it moves. For safety, screens and the score; never for a stop decision."""

    time_s: float
    position: GeodeticPosition
    velocity_ned_mps: tuple[float, float, float]


@dataclass
class Telemetry:
    """The latest of everything a vehicle has said."""

    last_message_s: float = float("-inf")
    heartbeat: Heartbeat | None = None
    kinematics: Kinematics | None = None
    relative_altitude_m: float | None = None
    estimator_flags: int = 0
    sensors_healthy: int = 0
    """MAV_SYS_STATUS_SENSOR bits of what the autopilot calls healthy."""
    status_texts: deque[str] = field(default_factory=lambda: deque(maxlen=_STATUS_TEXTS_KEPT))


class Vehicle:
    """One vehicle: telemetry in, commands out."""

    def __init__(self, name: str, system_id: int, link: Link, clock: Clock) -> None:
        self.name = name
        self.system_id = system_id
        self.link = link
        self.clock = clock
        self.telemetry = Telemetry()
        self.on_heartbeat: list[Callable[[Heartbeat], None]] = []
        self.on_kinematics: list[Callable[[Kinematics], None]] = []
        self._changed = asyncio.Event()
        self._acks: dict[int, asyncio.Future[int]] = {}
        link.listen(Subscription(system_id, frozenset(_READERS), self._receive))

    @property
    def armed(self) -> bool:
        """Whether the last heartbeat said armed."""
        return self.telemetry.heartbeat is not None and self.telemetry.heartbeat.armed

    @property
    def custom_mode(self) -> int | None:
        """The mode of the last heartbeat, or None before the first."""
        return None if self.telemetry.heartbeat is None else self.telemetry.heartbeat.custom_mode

    def silent_for_s(self) -> float:
        """Return the time since the last message of any kind, s."""
        return self.clock.now_s() - self.telemetry.last_message_s

    def failure(self, problem: str, way_out: str) -> VehicleError:
        """Return an error about this vehicle, with what the autopilot said last."""
        texts = "; ".join(self.telemetry.status_texts)
        said = f" (the autopilot says: {texts})" if texts else ""
        return VehicleError(self.name, str(self.link.address), problem + said, way_out)

    async def wait_until(self, condition: Callable[[], bool], timeout_s: float, awaited: str, way_out: str) -> None:
        """Return when telemetry makes `condition` true; VehicleError after `timeout_s`."""
        deadline_s = self.clock.now_s() + timeout_s
        while not condition():
            if self.clock.now_s() >= deadline_s:
                raise self.failure(f"no {awaited} within {timeout_s:g} s", way_out)
            self._changed.clear()
            waiting = asyncio.ensure_future(self._changed.wait())
            timer = asyncio.ensure_future(self.clock.sleep(deadline_s - self.clock.now_s()))
            try:
                await asyncio.wait((waiting, timer), return_when=asyncio.FIRST_COMPLETED)
            finally:
                waiting.cancel()
                timer.cancel()

    def tell(self, command: int, *parameters: float) -> None:
        """Send a command without waiting for its acknowledgement."""
        self.link.post(self._command(command, parameters))

    def tell_urgently(self, command: int, *parameters: float) -> None:
        """Send a command ahead of everything that waits."""
        self.link.drop_setpoint(self.system_id)
        self.link.post_urgent(self._command(command, parameters))

    async def command(self, command: int, *parameters: float, what: str) -> None:
        """Send a command once and wait for its acknowledgement.

        Raises VehicleError when it is refused or unanswered; it is never sent a second time.
        """
        answer: asyncio.Future[int] = asyncio.get_running_loop().create_future()
        self._acks[command] = answer
        self.tell(command, *parameters)
        timer = asyncio.ensure_future(self.clock.sleep(ACK_TIMEOUT_S))
        try:
            await asyncio.wait((answer, timer), return_when=asyncio.FIRST_COMPLETED)
        finally:
            timer.cancel()
            self._acks.pop(command, None)
        if not answer.done():
            raise self.failure(
                f"{what} not acknowledged within {ACK_TIMEOUT_S:g} s", "Check the link in both directions."
            )
        if answer.result() != mavlink.MAV_RESULT_ACCEPTED:
            result = mavlink.enums["MAV_RESULT"][answer.result()].name if answer.result() <= 9 else answer.result()
            raise self.failure(
                f"{what} refused with {result}", "Clear what the autopilot complains about, then try again."
            )

    async def request_rates(self, rates_hz: Mapping[int, float]) -> None:
        """Ask for messages by their id at a rate each. VehicleError when one is refused."""
        for message_id, rate_hz in rates_hz.items():
            await self.command(
                mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz, what=f"rate of message {message_id}"
            )

    def _command(self, command: int, parameters: tuple[float, ...]) -> Message:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        return mavlink.MAVLink_command_long_message(self.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, command, 0, *padded)

    def _receive(self, message: Message) -> None:
        self.telemetry.last_message_s = self.clock.now_s()
        _READERS[message.get_msgId()](self, message)
        self._changed.set()

    def _read_heartbeat(self, message: Message) -> None:
        heartbeat = Heartbeat(
            time_s=self.clock.now_s(),
            vehicle_type=message.type,
            autopilot=message.autopilot,
            custom_mode=message.custom_mode,
            armed=bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
            system_status=message.system_status,
        )
        self.telemetry.heartbeat = heartbeat
        for listener in self.on_heartbeat:
            listener(heartbeat)

    def _read_position(self, message: Message) -> None:
        kinematics = Kinematics(
            time_s=self.clock.now_s(),
            position=GeodeticPosition(message.lat * 1e-7, message.lon * 1e-7, message.alt * 1e-3),
            velocity_ned_mps=(message.vx * 0.01, message.vy * 0.01, message.vz * 0.01),
        )
        self.telemetry.kinematics = kinematics
        self.telemetry.relative_altitude_m = message.relative_alt * 1e-3
        for listener in self.on_kinematics:
            listener(kinematics)

    def _read_estimator(self, message: Message) -> None:
        self.telemetry.estimator_flags = message.flags

    def _read_system_status(self, message: Message) -> None:
        self.telemetry.sensors_healthy = message.onboard_control_sensors_health

    def _read_status_text(self, message: Message) -> None:
        self.telemetry.status_texts.append(message.text)

    def _read_ack(self, message: Message) -> None:
        answer = self._acks.get(message.command)
        if answer is not None and not answer.done() and message.result != mavlink.MAV_RESULT_IN_PROGRESS:
            answer.set_result(message.result)


_READERS: dict[int, Callable[[Vehicle, Message], None]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Vehicle._read_heartbeat,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: Vehicle._read_position,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: Vehicle._read_estimator,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: Vehicle._read_system_status,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: Vehicle._read_status_text,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: Vehicle._read_ack,
}
