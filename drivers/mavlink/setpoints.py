"""The leased setpoint streamer: velocity setpoints leave only while somebody keeps renewing the lease.

No renewal: zero velocity, then silence, and the autopilot's own guided time-out holds the vehicle. The streamer never
changes a mode; a heartbeat in any other mode than the guided one latches PILOT, and from then on nothing leaves until
the operator releases it.

Where guided flight ends with the stream, a vehicle that nobody moves is streamed the autopilot's idle setpoint, and a
gap in the stream counts as a take-over: whoever has the vehicle then must not lose it to a stream that comes back.
Guided flight cannot be entered there without one, either: on the operator's word the place where the vehicle is is
streamed for a while, so that he can ask for the mode himself.
"""

from __future__ import annotations

import cmath
import math
from dataclasses import dataclass
from enum import Enum
from typing import Final

from drivers.clock import Clock
from drivers.errors import SetpointError
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.codec import Message
from drivers.mavlink.link import Setpoint
from drivers.mavlink.setpoint_messages import velocity_setpoint
from drivers.mavlink.vehicle import Heartbeat, Vehicle

ZERO_REPEATED_S: Final = 2.0
"""How long zero velocity is repeated before silence: longer than a copter needs to stop."""

OFFERED_S: Final = 60.0
"""How long an idle setpoint is streamed for the operator to enter guided flight with."""

_ALTITUDE_GAIN_PER_S: Final = 0.5
_LARGEST_VERTICAL_MPS: Final = 1.0
_ALTITUDE_FRESH_S: Final = 1.0
_STANDING_MPS: Final = 0.5
_SOONEST_S: Final = 0.001
_SPEED_TOLERANCE: Final = 1.001


class StreamState(Enum):
    """What the streamer does now."""

    SILENT = "silent"
    LEASED = "leased"
    STOPPING = "stopping"
    IDLING = "idling"
    """Streaming the idle setpoint to an autopilot that would leave guided flight otherwise."""
    PILOT = "pilot"
    """Somebody else has the vehicle: a pilot, another station, or a failsafe of its own."""


@dataclass(frozen=True)
class StreamLimits:
    """The lease and what no setpoint may exceed."""

    rate_hz: float = 10.0
    lease_s: float = 0.5
    largest_speed_mps: float = 5.0


class SetpointStreamer:
    """Streams horizontal velocity to one vehicle at its altitude, on a lease."""

    def __init__(
        self, vehicle: Vehicle, autopilot: Autopilot, altitude_m: float, limits: StreamLimits, clock: Clock
    ) -> None:
        self.vehicle = vehicle
        self.state = StreamState.PILOT  # until a heartbeat says that the vehicle is in its guided mode
        self._autopilot = autopilot
        self._needs = autopilot.stream
        self._altitude_m = altitude_m
        self._limits = limits
        self._clock = clock
        self._velocity = 0j
        self._idle: Message | None = None
        self._lease_until_s = 0.0
        self._zero_until_s = 0.0
        self._sent_velocity = 0j
        self._last_sent_s = float("-inf")
        self._lost_s = float("-inf")
        self._offered_until_s = float("-inf")
        vehicle.on_heartbeat.append(self._watch_mode)
        heartbeat = vehicle.telemetry.heartbeat
        if heartbeat is not None and heartbeat.armed and autopilot.is_guided(heartbeat):
            self._rest()

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Fly this velocity (north + i east, m/s) from now until the lease ends, unless renewed before.

        Ignored in PILOT. Raises SetpointError when it is not finite or faster than the limit.
        """
        if not cmath.isfinite(velocity_north_east_mps):
            raise SetpointError(f"{self.vehicle.name}: velocity {velocity_north_east_mps} m/s is not finite")
        if abs(velocity_north_east_mps) > self._limits.largest_speed_mps * _SPEED_TOLERANCE:
            raise SetpointError(
                f"{self.vehicle.name}: {abs(velocity_north_east_mps):.2f} m/s is faster than the limit of "
                f"{self._limits.largest_speed_mps:g} m/s"
            )
        if not self._has_vehicle():
            return
        self.state = StreamState.LEASED
        self._velocity = velocity_north_east_mps
        self._lease_until_s = self._clock.now_s() + self._limits.lease_s
        self._send_velocity(expires_s=self._lease_until_s)

    def stop(self) -> None:
        """Send zero velocity at once, ahead of everything else, and repeat it while the vehicle stops."""
        if not self._has_vehicle():
            return
        self.state = StreamState.STOPPING
        self._velocity = 0j
        self._zero_until_s = self._clock.now_s() + ZERO_REPEATED_S
        self._send_velocity(expires_s=self._zero_until_s)

    def release(self) -> str | None:
        """Give the vehicle back to the service after a pilot's take-over: the operator's word, never the service's.

        Returns None when the vehicle is the service's, or else why not yet and what to do: a heartbeat since the
        take-over has to say that it flies in its guided mode, which the operator asks for, never the service.
        """
        heartbeat = self.vehicle.telemetry.heartbeat
        if self.state is not StreamState.PILOT:
            return None
        if heartbeat is None or heartbeat.time_s <= self._lost_s:
            return "no heartbeat since it was lost: check its link, and try again in a second"
        if not heartbeat.armed:
            return "it is disarmed: it has to fly before it can be flown"
        if self._autopilot.is_guided(heartbeat):
            self._rest()
            return None
        switch = "switch it to its guided mode (GUIDED of ArduPilot, OFFBOARD of PX4) yourself"
        if self._needs.idle_setpoint is None:
            return f"it flies in another mode: {switch}, then release it again"
        self._offered_until_s = self._clock.now_s() + OFFERED_S
        return (
            f"it flies in another mode, and guided flight needs a stream: for {OFFERED_S:.0f} s it is streamed the "
            f"place where it is; {switch} within this, and it is released"
        )

    async def run(self) -> None:
        """Repeat the current setpoint at the rate, and end it when the lease ends."""
        period_s = 1.0 / self._limits.rate_hz
        while True:
            await self._clock.sleep(self._until_due_s(period_s))
            self._tick(self._clock.now_s(), period_s)

    def _until_due_s(self, period_s: float) -> float:
        """Return for how long there is nothing to send, s: whatever is renewed meanwhile is sent by whoever renews."""
        if self.state in (StreamState.SILENT, StreamState.PILOT):
            return period_s / 2
        due_s = self._last_sent_s + period_s
        if self.state is StreamState.LEASED:
            due_s = min(due_s, self._lease_until_s)
        return max(due_s - self._clock.now_s(), _SOONEST_S)

    def _tick(self, now_s: float, period_s: float) -> None:
        if self.state is StreamState.SILENT:
            return
        if not self._has_vehicle():
            if now_s < self._offered_until_s and now_s - self._last_sent_s >= period_s:
                self._idle_here()
        elif self.state is StreamState.LEASED and now_s >= self._lease_until_s:
            self.stop()
        elif self.state is StreamState.STOPPING and (now_s >= self._zero_until_s or self._stands()):
            self._rest()
        elif now_s - self._last_sent_s >= period_s:
            self._repeat()

    def _stands(self) -> bool:
        """Return whether the vehicle is slow enough to be held by its idle setpoint, where it has one."""
        kinematics = self.vehicle.telemetry.kinematics
        if self._needs.idle_setpoint is None or kinematics is None:
            return False
        return math.hypot(*kinematics.velocity_ned_mps[:2]) < _STANDING_MPS

    def _repeat(self) -> None:
        if self.state is StreamState.IDLING:
            self._send_idle()
        else:
            leased = self.state is StreamState.LEASED
            self._send_velocity(expires_s=self._lease_until_s if leased else self._zero_until_s)

    def _rest(self) -> None:
        """Be silent, or keep the stream up with a setpoint that moves nothing."""
        self._offered_until_s = float("-inf")
        if self._needs.idle_setpoint is None:
            self.state = StreamState.SILENT
            return
        self.state = StreamState.IDLING
        self._idle_here()

    def _idle_here(self) -> None:
        if self._needs.idle_setpoint is not None:
            self._idle = self._needs.idle_setpoint(self.vehicle, self._altitude_m)
            self._send_idle()

    def _watch_mode(self, heartbeat: Heartbeat) -> None:
        if not self._autopilot.is_guided(heartbeat):
            self._leave()
        elif self.state is StreamState.PILOT and heartbeat.armed and heartbeat.time_s < self._offered_until_s:
            self._rest()

    def _has_vehicle(self) -> bool:
        """Return whether the vehicle is the service's to move; after a gap in the stream it no longer is."""
        now_s = self._clock.now_s()
        gap_s = max(now_s - self._last_sent_s, self.vehicle.silent_for_s())  # one unheard may not have heard either
        if self.state is not StreamState.PILOT and gap_s > self._needs.longest_gap_s:
            self._lost_s = now_s
            self._leave()
        return self.state is not StreamState.PILOT

    def _leave(self) -> None:
        self.state = StreamState.PILOT
        self.vehicle.link.drop_setpoint(self.vehicle.system_id)

    def _send_velocity(self, expires_s: float) -> None:
        velocity = self._reachable(self._velocity)
        message = velocity_setpoint(self.vehicle.system_id, velocity, self._vertical_mps())
        self._post(Setpoint(message, expires_s, stops=velocity == 0j), velocity)

    def _send_idle(self) -> None:
        expires_s = self._clock.now_s() + self._limits.lease_s
        self._post(Setpoint(self._idle, expires_s, stops=False), 0j)

    def _post(self, setpoint: Setpoint, velocity: complex) -> None:
        self._last_sent_s, self._sent_velocity = self._clock.now_s(), velocity
        self.vehicle.link.post_setpoint(self.vehicle.system_id, setpoint)

    def _reachable(self, velocity: complex) -> complex:
        """Return the velocity to send on the way to the wanted one; a stop is never slowed down."""
        if self._needs.acceleration_mps2 is None or velocity == 0j:
            return velocity
        passed_s = min(self._clock.now_s() - self._last_sent_s, 1.0 / self._limits.rate_hz)
        largest_mps, change = self._needs.acceleration_mps2 * passed_s, velocity - self._sent_velocity
        if abs(change) <= largest_mps:
            return velocity
        return self._sent_velocity + change * (largest_mps / abs(change))

    def _vertical_mps(self) -> float:
        """Return the downward speed of the slow altitude loop, m/s; level when the altitude is not fresh."""
        telemetry = self.vehicle.telemetry
        if telemetry.relative_altitude_m is None or telemetry.kinematics is None:
            return 0.0
        if self._clock.now_s() - telemetry.kinematics.time_s > _ALTITUDE_FRESH_S:
            return 0.0
        down = _ALTITUDE_GAIN_PER_S * (telemetry.relative_altitude_m - self._altitude_m)
        return max(-_LARGEST_VERTICAL_MPS, min(_LARGEST_VERTICAL_MPS, down))
