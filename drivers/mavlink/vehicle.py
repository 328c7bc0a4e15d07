"""One vehicle behind a link: its state as its telemetry tells it, and commands it acknowledges."""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable, Iterator
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import VehicleError
from drivers.mavlink.acknowledgements import Acknowledgements
from drivers.mavlink.boot_clock import BootClock
from drivers.mavlink.codec import Message
from drivers.mavlink.link import Channel, Subscription
from drivers.mavlink.message_rates import MessageRates
from drivers.mavlink.status_texts import StatusTexts
from drivers.mavlink.telemetry import Battery, Heartbeat, Kinematics, Telemetry

ACK_TIMEOUT_S: Final = 3.0
ONE_REBOOT_S: Final = 5.0
"""Several signs of a reboot in this time are of one."""
OVERTAKEN_S: Final = 5.0
"""A position older than the newest is not taken for this long after that one came."""

__all__ = ["Battery", "Heartbeat", "Kinematics", "Telemetry", "Vehicle"]


class Vehicle:
    """One vehicle: telemetry in, commands out."""

    def __init__(self, name: str, system_id: int, link: Channel, clock: Clock) -> None:
        self.name = name
        self.system_id = system_id
        self.link = link
        self.clock = clock
        self.telemetry = Telemetry()
        self.reboots = 0
        """How often the autopilot has rebooted since it was first heard."""
        self.on_heartbeat: list[Callable[[Heartbeat], None]] = []
        self.on_kinematics: list[Callable[[Kinematics], None]] = []
        self.on_text: list[Callable[[str], None]] = []
        """Get what the autopilot says, in whole texts."""
        self.on_notice: list[Callable[[str], None]] = []
        """Get what the operator should hear of, in words: a reboot, telemetry that stopped."""
        self.rates = MessageRates(clock, self._request_rate)
        self._changed = asyncio.Event()
        self._acknowledgements = Acknowledgements(clock)
        self._boot_clock = BootClock()
        self._rebooted_s = float("-inf")
        self._position_boot_ms = 0
        self._texts = StatusTexts()
        self._listeners: dict[int, list[Callable[[Message], None]]] = {}
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
        if not await self.holds_within(timeout_s, condition):
            raise self.failure(f"no {awaited} within {timeout_s:g} s", way_out)

    async def holds_within(self, timeout_s: float, condition: Callable[[], bool]) -> bool:
        """Return True as soon as telemetry makes `condition` true, False after `timeout_s`."""
        deadline_s = self.clock.now_s() + timeout_s
        while not condition():
            if self.clock.now_s() >= deadline_s:
                return False
            self._changed.clear()
            waiting = asyncio.ensure_future(self._changed.wait())
            timer = asyncio.ensure_future(self.clock.sleep(deadline_s - self.clock.now_s()))
            try:
                await asyncio.wait((waiting, timer), return_when=asyncio.FIRST_COMPLETED)
            finally:
                waiting.cancel()
                timer.cancel()
        return True

    def tell(self, command: int, *parameters: float) -> None:
        """Send a command without waiting for its acknowledgement."""
        self._acknowledgements.expect_unheeded(command)
        self.link.post(self._command(command, parameters))

    def tell_urgently(self, command: int, *parameters: float) -> None:
        """Send a command ahead of everything that waits."""
        self._acknowledgements.expect_unheeded(command)
        self.link.drop_setpoint(self.system_id)
        self.link.post_urgent(self._command(command, parameters))

    async def command(self, command: int, *parameters: float, what: str) -> None:
        """Send a command once and wait for its acknowledgement.

        Raises VehicleError when it is refused or unanswered; it is never sent a second time. Nor is it sent at all
        while the answer to an earlier one of its number may still come, which would be taken for its own.
        """
        if not self._acknowledgements.is_free(command):
            raise self.failure(
                f"{what} not sent: command {command} was sent before, and its answer may still come",
                "Wait half a minute, and check the link in both directions.",
            )
        answer = self._acknowledgements.expect(command)
        self.link.post(self._command(command, parameters))
        timer = asyncio.ensure_future(self.clock.sleep(ACK_TIMEOUT_S))
        try:
            await asyncio.wait((answer, timer), return_when=asyncio.FIRST_COMPLETED)
        finally:
            timer.cancel()
            self._acknowledgements.stop_waiting(command)
        if not answer.done():
            raise self.failure(
                f"{what} not acknowledged within {ACK_TIMEOUT_S:g} s", "Check the link in both directions."
            )
        if answer.result() != mavlink.MAV_RESULT_ACCEPTED:
            entry = mavlink.enums["MAV_RESULT"].get(answer.result())
            raise self.failure(
                f"{what} refused with {answer.result() if entry is None else entry.name}",
                "Clear what the autopilot complains about, then try again.",
            )

    @contextlib.contextmanager
    def hearing(self, message_id: int, listener: Callable[[Message], None]) -> Iterator[None]:
        """Hand a listener every message of one id for as long as the block lasts."""
        listeners = self._listeners.setdefault(message_id, [])
        listeners.append(listener)
        try:
            yield
        finally:
            listeners.remove(listener)

    def _request_rate(self, message_id: int, rate_hz: float) -> None:
        self.tell(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, message_id, 1e6 / rate_hz)

    def _command(self, command: int, parameters: tuple[float, ...]) -> Message:
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        return mavlink.MAVLink_command_long_message(self.system_id, mavlink.MAV_COMP_ID_AUTOPILOT1, command, 0, *padded)

    def _receive(self, message: Message) -> None:
        message_id = message.get_msgId()
        self.telemetry.last_message_s = self.clock.now_s()
        self.rates.came(message_id)
        _READERS[message_id](self, message)
        for listener in tuple(self._listeners.get(message_id, ())):
            listener(message)
        self._changed.set()

    def _read_heartbeat(self, message: Message) -> None:
        heartbeat = Heartbeat.of(message, self.clock.now_s())
        last, self.telemetry.heartbeat = self.telemetry.heartbeat, heartbeat
        for listener in self.on_heartbeat:  # first: a mode that is not the guided one ends setpoints
            listener(heartbeat)
        if last is not None and heartbeat.system_status == mavlink.MAV_STATE_BOOT != last.system_status:
            self._rebooted()
        elif self.rates.review():
            self._notify("stopped sending what was asked of it, and was asked again")

    def _read_position(self, message: Message) -> None:
        kinematics = Kinematics.of(message, self.clock.now_s())
        if kinematics is None:
            return
        self._hear_boot_time(message.time_boot_ms * 1e-3)
        last = self.telemetry.kinematics
        if message.time_boot_ms < self._position_boot_ms and last is not None and self._is_recent(last):
            return  # overtaken on its way
        self._position_boot_ms = message.time_boot_ms
        self.telemetry.kinematics = kinematics
        self.telemetry.relative_altitude_m = message.relative_alt * 1e-3
        for listener in self.on_kinematics:
            listener(kinematics)

    def _read_system_time(self, message: Message) -> None:
        self._hear_boot_time(message.time_boot_ms * 1e-3)

    def _read_timesync(self, message: Message) -> None:
        """Take the autopilot's own time from its answer, or from a question of its own."""
        self._hear_boot_time((message.tc1 or message.ts1) * 1e-9)

    def _read_estimator(self, message: Message) -> None:
        self.telemetry.estimator_flags = message.flags

    def _read_system_status(self, message: Message) -> None:
        self.telemetry.sensors_healthy = message.onboard_control_sensors_health
        self.telemetry.battery = Battery.of(message)

    def _read_status_text(self, message: Message) -> None:
        for text in self._texts.take(message):
            self.telemetry.status_texts.append(text)
            for listener in self.on_text:
                listener(text)

    def _read_ack(self, message: Message) -> None:
        if message.result != mavlink.MAV_RESULT_IN_PROGRESS:
            self._acknowledgements.take(message.command, message.result)

    def _is_recent(self, kinematics: Kinematics) -> bool:
        return self.clock.now_s() - kinematics.time_s <= OVERTAKEN_S

    def _pass_on(self, _message: Message) -> None:
        """Leave a message to whoever listens for it."""

    def _hear_boot_time(self, boot_s: float) -> None:
        if self._boot_clock.restarted(boot_s, self.clock.now_s()):
            self._rebooted()

    def _rebooted(self) -> None:
        """Forget what the autopilot before the reboot said of itself, and ask anew for what it sent.

        What a reboot means for the flight is said by the mode: a rebooted vehicle is not in its guided one.
        """
        if self.clock.now_s() - self._rebooted_s < ONE_REBOOT_S:
            return
        self._rebooted_s = self.clock.now_s()
        self.reboots += 1
        self._boot_clock.forget()
        self._position_boot_ms = 0
        telemetry = self.telemetry
        telemetry.kinematics = telemetry.relative_altitude_m = telemetry.battery = None
        telemetry.estimator_flags = telemetry.sensors_healthy = 0
        self.rates.ask_again()
        self._notify("has rebooted")

    def _notify(self, words: str) -> None:
        for listener in self.on_notice:
            listener(f"{self.name} {words}")


_READERS: dict[int, Callable[[Vehicle, Message], None]] = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: Vehicle._read_heartbeat,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: Vehicle._read_position,
    mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: Vehicle._read_system_time,
    mavlink.MAVLINK_MSG_ID_TIMESYNC: Vehicle._read_timesync,
    mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: Vehicle._read_estimator,
    mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS: Vehicle._read_estimator,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: Vehicle._read_system_status,
    mavlink.MAVLINK_MSG_ID_STATUSTEXT: Vehicle._read_status_text,
    mavlink.MAVLINK_MSG_ID_COMMAND_ACK: Vehicle._read_ack,
    mavlink.MAVLINK_MSG_ID_PARAM_VALUE: Vehicle._pass_on,
    mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: Vehicle._pass_on,
}
