"""What the service asks of an autopilot; the rest of the driver never asks which one it is."""

from __future__ import annotations

from typing import Protocol

from drivers.mavlink.vehicle import Heartbeat, Vehicle


class Autopilot(Protocol):
    """How one kind of autopilot is made ready, taken into guided flight and out of it."""

    @property
    def vehicle_types(self) -> frozenset[int]:
        """The MAV_TYPEs this strategy can fly."""
        ...

    def is_guided(self, heartbeat: Heartbeat) -> bool:
        """Return whether the vehicle obeys this service's setpoints; anything else is the pilot's or a failsafe's."""
        ...

    async def prepare(self, vehicle: Vehicle) -> None:
        """Ask for the telemetry that is used and wait until the position estimate is ready."""
        ...

    async def take_off(self, vehicle: Vehicle, altitude_m: float) -> None:
        """Enter the guided mode, arm, and climb to `altitude_m` above home. VehicleError when any of it is refused."""
        ...

    def hold(self, vehicle: Vehicle) -> None:
        """Stop the vehicle where it is, by a mode of its own, ahead of everything else."""
        ...

    async def land(self, vehicle: Vehicle) -> None:
        """Land where it is and wait until disarmed."""
        ...
