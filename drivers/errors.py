"""What can go wrong with the outside world: each error says what, where and the way out."""

from __future__ import annotations


class DriverError(RuntimeError):
    """Base of every error the drivers raise on purpose."""


class LinkError(DriverError):
    """A MAVLink link could not be opened or does not exist as written."""


class VehicleError(DriverError):
    """A vehicle did not do, or may not do, what was asked of it."""

    def __init__(self, vehicle: str, link: str, problem: str, way_out: str) -> None:
        self.vehicle = vehicle
        self.link = link
        self.problem = problem
        self.way_out = way_out
        super().__init__(f"{vehicle} on {link}: {problem}. {way_out}")


class SetpointError(DriverError):
    """A setpoint that must never leave: not finite, or faster than the vehicle's limit."""


class BusError(DriverError):
    """The zenoh bus could not be opened."""


class SimulationError(DriverError):
    """A simulated vehicle, sensor or bus process could not be started."""


class SensorError(DriverError):
    """An AOA sensor cannot be read from, or not as its settings say."""
