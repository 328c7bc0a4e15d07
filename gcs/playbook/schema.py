"""The schema of a playbook. Lengths in metres, angles in degrees, points in the formation frame."""

from __future__ import annotations

import cmath
import math
from typing import Annotated, Any, Literal

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, StringConstraints, model_validator

from drivers.bus.keys import NAME_PATTERN
from drivers.errors import LinkError
from drivers.mavlink.transport import LinkAddress
from planner import formations
from planner.frames import FormationFrame, GeodeticPosition
from planner.methods import METHODS
from planner.relay import RelayProblem

Name = Annotated[str, StringConstraints(pattern=f"^{NAME_PATTERN}$", max_length=64)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, frozen=True, allow_inf_nan=False)


def _read_point(value: Any) -> complex:
    if isinstance(value, list) and len(value) == 2 and all(map(_is_number, value)):
        return complex(*value)
    if isinstance(value, dict) and value.keys() == {"radius_m", "angle_deg"} and all(map(_is_number, value.values())):
        return cmath.rect(value["radius_m"], math.radians(value["angle_deg"]))
    raise ValueError("a point is [x, y] in metres, or {radius_m: ..., angle_deg: ...}")


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _read_link(value: Any) -> str:
    try:
        return str(LinkAddress.parse(value if isinstance(value, str) else ""))
    except LinkError as error:
        raise ValueError(str(error)) from error


def _read_method(value: Any) -> str:
    if value not in METHODS:
        raise ValueError(f"a planning method is one of {', '.join(METHODS)}")
    return str(value)


Point = Annotated[complex, BeforeValidator(_read_point)]
Link = Annotated[str, BeforeValidator(_read_link)]
Method = Annotated[str, BeforeValidator(_read_method)]
Metres = Annotated[float, Field(gt=0.0, le=100_000.0)]


class Site(_Section):
    """Where the formation stands: L0's place, and the azimuth of the axis L0 -> L1."""

    latitude_deg: Annotated[float, Field(ge=-85.0, le=85.0)] = -35.363262
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 149.165237
    altitude_m: Annotated[float, Field(ge=-500.0, le=9000.0)] = 584.0
    axis_azimuth_deg: Annotated[float, Field(ge=-360.0, le=360.0)] = 90.0

    @property
    def origin(self) -> GeodeticPosition:
        """The origin of the site frame."""
        return GeodeticPosition(self.latitude_deg, self.longitude_deg, self.altitude_m)

    @property
    def frame(self) -> FormationFrame:
        """The formation frame on this site."""
        return FormationFrame(math.radians(self.axis_azimuth_deg))


class CircleFormation(_Section):
    """Slots O1.. on the circle about L0, 360/(slots + 1) degrees apart."""

    kind: Literal["circle"]
    slots: Annotated[int, Field(ge=1, le=10_000)]
    radius_m: Metres

    def points(self) -> dict[str, complex]:
        """Return the slots by name."""
        return formations.circle(self.slots, self.radius_m)


class CustomFormation(_Section):
    """Slots wherever they are written, in relay order."""

    kind: Literal["custom"]
    slots: Annotated[dict[Name, Point], Field(min_length=1)]

    def points(self) -> dict[str, complex]:
        """Return the slots by name."""
        return formations.custom(self.slots)


class Transmitter(_Section):
    """A transmitter from the start: a UAV standing in its place, or a ground beacon."""

    at: Point
    beacon: bool = False


class Receiver(_Section):
    """A receiver and where it starts."""

    start: Point


class VehicleLink(_Section):
    """How a UAV is reached over MAVLink."""

    link: Link
    system_id: Annotated[int, Field(ge=1, le=254)]


class Planner(_Section):
    """How the relay is planned."""

    method: Method = "paper"
    min_separation_m: Metres = 5.0


class Flight(_Section):
    """How the relay is flown."""

    altitude_m: Annotated[float, Field(ge=2.0, le=500.0)] = 20.0
    speed_mps: Annotated[float, Field(ge=0.5, le=10.0)] = 5.0
    placement_tolerance_m: Metres = 3.0
    lease_s: Annotated[float, Field(ge=0.1, le=1.0)] = 0.5
    give_up_s: Annotated[float, Field(ge=1.0, le=60.0)] = 5.0
    land_after: bool = False


class SensorSection(_Section):
    """The AOA sensors: their noise (one standard deviation), and how the simulated ones behave."""

    sigma_deg: Annotated[float, Field(ge=0.0, le=20.0)] = 0.1
    rate_hz: Annotated[float, Field(ge=2.0, le=50.0)] = 10.0
    latency_s: Annotated[float, Field(ge=0.0, le=0.4)] = 0.1
    drop_out: Annotated[float, Field(ge=0.0, lt=1.0)] = 0.0


class BusSection(_Section):
    """The zenoh bus. Without a router endpoint the service starts its own router on loopback."""

    router: Annotated[str, StringConstraints(pattern=r"^(tcp|tls|quic|udp)/.+:\d+$")] | None = None


class Playbook(_Section):
    """A run: site, formation, UAVs, and how to plan and fly."""

    playbook: Literal[1]
    name: Name
    site: Site = Site()
    formation: Annotated[CircleFormation | CustomFormation, Field(discriminator="kind")]
    transmitters: Annotated[dict[Name, Transmitter], Field(min_length=2)]
    receivers: Annotated[dict[Name, Receiver], Field(min_length=1)]
    vehicles: dict[Name, VehicleLink] | None = None
    planner: Planner = Planner()
    flight: Flight = Flight()
    sensor: SensorSection = SensorSection()
    bus: BusSection = BusSection()

    @model_validator(mode="after")
    def _consistent(self) -> Playbook:
        if self.vehicles is not None and (missing := set(self.uavs) - self.vehicles.keys()):
            raise ValueError(
                f"vehicles: {', '.join(sorted(missing))} have no link (leave out 'vehicles' to simulate all)"
            )
        if self.vehicles is not None and (unknown := self.vehicles.keys() - set(self.uavs)):
            raise ValueError(f"vehicles: {', '.join(sorted(unknown))} are neither transmitters nor receivers")
        self.problem()
        return self

    @property
    def uavs(self) -> dict[str, complex]:
        """Every UAV and where it starts, formation frame, m; beacons are none."""
        standing = {name: transmitter.at for name, transmitter in self.transmitters.items() if not transmitter.beacon}
        return standing | {name: receiver.start for name, receiver in self.receivers.items()}

    @property
    def beacons(self) -> dict[str, complex]:
        """Every ground beacon and its place, formation frame, m."""
        return {name: transmitter.at for name, transmitter in self.transmitters.items() if transmitter.beacon}

    def problem(self, min_separation_m: float | None = None) -> RelayProblem:
        """Return the relay problem of this playbook, with its own separation or another (0 switches it off)."""
        return RelayProblem(
            transmitters={name: transmitter.at for name, transmitter in self.transmitters.items()},
            receivers={name: receiver.start for name, receiver in self.receivers.items()},
            slots=self.formation.points(),
            min_separation_m=self.planner.min_separation_m if min_separation_m is None else min_separation_m,
            speed_mps=self.flight.speed_mps,
        )
