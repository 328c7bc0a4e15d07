"""What the service asks of an autopilot; the rest of the driver never asks which one it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from pymavlink.dialects.v20 import ardupilotmega as mavlink

from drivers.mavlink.checks import ParameterCheck, Parameters
from drivers.mavlink.codec import Message
from drivers.mavlink.parameters import ParameterValue
from drivers.mavlink.vehicle import Heartbeat, Vehicle

MULTICOPTERS: Final = frozenset(
    {
        mavlink.MAV_TYPE_QUADROTOR,
        mavlink.MAV_TYPE_HEXAROTOR,
        mavlink.MAV_TYPE_OCTOROTOR,
        mavlink.MAV_TYPE_TRICOPTER,
        mavlink.MAV_TYPE_COAXIAL,
        mavlink.MAV_TYPE_DECAROTOR,
        mavlink.MAV_TYPE_DODECAROTOR,
    }
)

IdleSetpoint = Callable[[Vehicle, float], Message]
"""Returns the setpoint that keeps a vehicle where it is now, at an altitude above home, m."""


@dataclass(frozen=True)
class StreamNeeds:
    """What an autopilot needs of its setpoint stream; the default suits one that hovers by itself in silence."""

    idle_setpoint: IdleSetpoint | None = None
    """Where guided flight ends with the stream: what is streamed to a vehicle that nobody moves."""
    longest_gap_s: float = math.inf
    """After a longer gap the autopilot may have left guided flight, and would be seized by a stream that comes back."""
    acceleration_mps2: float | None = None
    """It follows a jump in velocity at once: the stream changes it no faster. None where the autopilot shapes it."""


@dataclass(frozen=True)
class ParameterKnowledge:
    """How one kind of autopilot tells its parameters, and what of them matters before a flight."""

    value_of: ParameterValue
    checks: tuple[ParameterCheck, ...]
    return_reads: tuple[str, ...]
    """The parameters that `failsafe_return_altitude_m` needs."""
    failsafe_return_altitude_m: Callable[[Parameters], float | None]
    """Returns at what height above home it flies home by itself when this service has gone; None when it does not."""

    @property
    def reads(self) -> tuple[str, ...]:
        """The names of all parameters that are looked at."""
        return (*self.return_reads, *(name for check in self.checks for name in check.reads))


class Autopilot(Protocol):
    """How one kind of autopilot is checked, made ready, taken into guided flight and out of it."""

    @property
    def name(self) -> str:
        """What people call it."""
        ...

    @property
    def vehicle_types(self) -> frozenset[int]:
        """The MAV_TYPEs this strategy can fly."""
        ...

    @property
    def stream(self) -> StreamNeeds:
        """What it needs of its setpoint stream."""
        ...

    @property
    def parameters(self) -> ParameterKnowledge:
        """What its parameters mean."""
        ...

    @property
    def complaint(self) -> str:
        """How the texts begin with which it says what keeps it from arming."""
        ...

    def is_guided(self, heartbeat: Heartbeat) -> bool:
        """Return whether the vehicle obeys this service's setpoints; anything else is the pilot's or a failsafe's."""
        ...

    async def prepare(self, vehicle: Vehicle) -> None:
        """Ask for the telemetry that is used and wait for a position estimate. VehicleError when none comes."""
        ...

    async def arm(self, vehicle: Vehicle) -> None:
        """Arm it once, on the ground, in a mode that it can take off from. VehicleError when it is refused.

        It disarms itself when no take-off follows within seconds.
        """
        ...

    async def take_off(self, vehicle: Vehicle, altitude_m: float) -> None:
        """Enter the guided mode, arm, and climb to `altitude_m` above home. VehicleError when any of it is refused.

        One that is armed is not armed again, and one that already flies there only enters the guided mode.
        Where guided flight needs a stream, the caller takes it over without a gap.
        """
        ...

    def hold(self, vehicle: Vehicle) -> None:
        """Stop the vehicle where it is, by a mode of its own, ahead of everything else."""
        ...

    async def land(self, vehicle: Vehicle) -> None:
        """Land where it is and wait until disarmed."""
        ...

    async def return_home(self, vehicle: Vehicle) -> None:
        """Fly home by the autopilot's own return mode, land there and wait until disarmed."""
        ...
