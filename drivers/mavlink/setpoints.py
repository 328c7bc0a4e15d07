"""The leased setpoint streamer: velocity setpoints leave only while somebody keeps renewing the lease.

No renewal: zero velocity, then silence, and the autopilot's own guided time-out holds the vehicle. The streamer never
changes a mode; a heartbeat in any other mode than the guided one latches PILOT, and from then on nothing leaves until
the operator releases it.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass
from enum import Enum
from typing import Final

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.clock import Clock
from drivers.errors import SetpointError
from drivers.mavlink.autopilots.base import Autopilot
from drivers.mavlink.codec import Message
from drivers.mavlink.link import Setpoint
from drivers.mavlink.vehicle import Heartbeat, Vehicle

TYPE_MASK: Final = 0x05C7
"""Velocity and yaw rate only; yaw rate 0 holds the heading, which antenna arrays care about."""

ZERO_REPEATED_S: Final = 2.0
"""How long zero velocity is repeated before silence: longer than a copter needs to stop."""

_ALTITUDE_GAIN_PER_S: Final = 0.5
_LARGEST_VERTICAL_MPS: Final = 1.0
_ALTITUDE_FRESH_S: Final = 1.0
_SPEED_TOLERANCE: Final = 1.001


class StreamState(Enum):
    """What the streamer does now."""

    SILENT = "silent"
    LEASED = "leased"
    STOPPING = "stopping"
    PILOT = "pilot"


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
        self._altitude_m = altitude_m
        self._limits = limits
        self._clock = clock
        self._velocity = 0j
        self._lease_until_s = 0.0
        self._zero_until_s = 0.0
        self._last_sent_s = float("-inf")
        vehicle.on_heartbeat.append(self._watch_mode)
        self.release()

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
        if self.state is StreamState.PILOT:
            return
        self.state = StreamState.LEASED
        self._velocity = velocity_north_east_mps
        self._lease_until_s = self._clock.now_s() + self._limits.lease_s
        self._send(velocity_north_east_mps, expires_s=self._lease_until_s)

    def stop(self) -> None:
        """Send zero velocity at once, ahead of everything else, repeat it while the vehicle stops, then be silent."""
        if self.state is StreamState.PILOT:
            return
        self.state = StreamState.STOPPING
        self._velocity = 0j
        self._zero_until_s = self._clock.now_s() + ZERO_REPEATED_S
        self._send(0j, expires_s=self._zero_until_s)

    def release(self) -> None:
        """Give the vehicle back to the service after a pilot's take-over: the operator's word, never the service's."""
        heartbeat = self.vehicle.telemetry.heartbeat
        if self.state is StreamState.PILOT and heartbeat is not None and self._autopilot.is_guided(heartbeat):
            self.state = StreamState.SILENT

    async def run(self) -> None:
        """Repeat the current setpoint at the rate, and end it when the lease ends."""
        period_s = 1.0 / self._limits.rate_hz
        while True:
            await self._clock.sleep(period_s / 2)
            self._tick(self._clock.now_s(), period_s)

    def _tick(self, now_s: float, period_s: float) -> None:
        if self.state is StreamState.LEASED and now_s >= self._lease_until_s:
            self.stop()
        elif self.state is StreamState.STOPPING and now_s >= self._zero_until_s:
            self.state = StreamState.SILENT
        elif self.state in (StreamState.LEASED, StreamState.STOPPING) and now_s - self._last_sent_s >= period_s:
            leased = self.state is StreamState.LEASED
            self._send(self._velocity, expires_s=self._lease_until_s if leased else self._zero_until_s)

    def _watch_mode(self, heartbeat: Heartbeat) -> None:
        if not self._autopilot.is_guided(heartbeat):
            self.state = StreamState.PILOT
            self.vehicle.link.drop_setpoint(self.vehicle.system_id)

    def _send(self, velocity: complex, expires_s: float) -> None:
        self._last_sent_s = self._clock.now_s()
        setpoint = Setpoint(self._setpoint(velocity), expires_s, stops=velocity == 0j)
        self.vehicle.link.post_setpoint(self.vehicle.system_id, setpoint)

    def _setpoint(self, velocity: complex) -> Message:
        return mavlink.MAVLink_set_position_target_local_ned_message(
            0,
            self.vehicle.system_id,
            mavlink.MAV_COMP_ID_AUTOPILOT1,
            mavlink.MAV_FRAME_LOCAL_NED,
            TYPE_MASK,
            *(0.0, 0.0, 0.0),
            *(velocity.real, velocity.imag, self._vertical_mps()),
            *(0.0, 0.0, 0.0),
            *(0.0, 0.0),
        )

    def _vertical_mps(self) -> float:
        """Return the downward speed of the slow altitude loop, m/s; level when the altitude is not fresh."""
        telemetry = self.vehicle.telemetry
        if telemetry.relative_altitude_m is None or telemetry.kinematics is None:
            return 0.0
        if self._clock.now_s() - telemetry.kinematics.time_s > _ALTITUDE_FRESH_S:
            return 0.0
        down = _ALTITUDE_GAIN_PER_S * (telemetry.relative_altitude_m - self._altitude_m)
        return max(-_LARGEST_VERTICAL_MPS, min(_LARGEST_VERTICAL_MPS, down))
