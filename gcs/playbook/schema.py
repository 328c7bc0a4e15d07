"""The schema of a playbook. Lengths in metres, angles in degrees, points in the formation frame."""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, StringConstraints, WithJsonSchema, model_validator

from gcs.playbook.formation import Formation
from gcs.playbook.links import Mavlink, VehicleLink, clashes
from gcs.playbook.sections import Degrees, Metres, Name, Point, Section
from gcs.playbook.sensor_section import SensorSection
from planner.frames import FormationFrame, GeodeticPosition
from planner.methods import DEFAULT_METHOD, METHODS
from planner.plan import RelayPlan
from planner.relay import Objective, RelayProblem


def _read_method(value: Any) -> str:
    if value not in METHODS:
        raise ValueError(f"a planning method is one of {', '.join(METHODS)}")
    return str(value)


Method = Annotated[str, BeforeValidator(_read_method), WithJsonSchema({"enum": list(METHODS)})]


class Site(Section):
    """Where the formation stands: L0's place, and the azimuth of the axis L0 -> L1."""

    latitude_deg: Annotated[float, Field(ge=-85.0, le=85.0)] = -35.363262
    longitude_deg: Annotated[float, Field(ge=-180.0, le=180.0)] = 149.165237
    altitude_m: Annotated[float, Field(ge=-500.0, le=9000.0)] = 584.0
    axis_azimuth_deg: Degrees = 90.0

    @property
    def origin(self) -> GeodeticPosition:
        """The origin of the site frame."""
        return GeodeticPosition(self.latitude_deg, self.longitude_deg, self.altitude_m)

    @property
    def frame(self) -> FormationFrame:
        """The formation frame on this site."""
        return FormationFrame(math.radians(self.axis_azimuth_deg))


class Transmitter(Section):
    """A transmitter from the start: a UAV standing in its place, or a ground beacon."""

    at: Point
    beacon: bool = False


class Receiver(Section):
    """A receiver and where it starts."""

    start: Point


class Planner(Section):
    """How the relay is planned."""

    method: Method = DEFAULT_METHOD
    objective: Objective = "length"
    min_separation_m: Metres = 5.0
    tolerance_3sigma_m: Metres | None = None
    max_leg_m: Metres | None = None
    fence: list[Point] = Field(default_factory=list)
    samples: Annotated[int, Field(ge=1, le=1000)] = 10
    start_sigma_m: Annotated[float, Field(ge=0.0, le=100.0)] = 1.0


class Flight(Section):
    """How the relay is flown."""

    altitude_m: Annotated[float, Field(ge=2.0, le=500.0)] = 20.0
    speed_mps: Annotated[float, Field(ge=0.5, le=10.0)] = 5.0
    placement_tolerance_m: Metres = 3.0
    lease_s: Annotated[float, Field(ge=0.1, le=1.0)] = 0.5
    give_up_s: Annotated[float, Field(ge=1.0, le=60.0)] = 5.0
    land_after: bool = False


class Simulation(Section):
    """The air that simulated vehicles fly in."""

    wind_mps: Annotated[float, Field(ge=0.0, le=30.0)] = 0.0
    wind_from_deg: Degrees = 0.0
    gusts_mps: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    gps_noise_m: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0


class BusSection(Section):
    """The zenoh bus. Without a router endpoint the service starts its own router on loopback."""

    router: Annotated[str, StringConstraints(pattern=r"^(tcp|tls|quic|udp)/.+:\d+$")] | None = None


class Playbook(Section):
    """A run: site, formation, UAVs, and how to plan and fly."""

    playbook: Literal[1]
    name: Name
    site: Site = Site()
    formation: Formation
    transmitters: Annotated[dict[Name, Transmitter], Field(min_length=2)]
    receivers: Annotated[dict[Name, Receiver], Field(min_length=1)]
    vehicles: dict[Name, VehicleLink] | None = None
    planner: Planner = Planner()
    flight: Flight = Flight()
    sensor: SensorSection = SensorSection()
    bus: BusSection = BusSection()
    mavlink: Mavlink = Mavlink()
    simulation: Simulation = Simulation()

    @model_validator(mode="after")
    def _consistent(self) -> Playbook:
        if self.vehicles is not None and (missing := set(self.uavs) - self.vehicles.keys()):
            raise ValueError(
                f"vehicles: {', '.join(sorted(missing))} have no link (leave out 'vehicles' to simulate all)"
            )
        if self.vehicles is not None and (unknown := self.vehicles.keys() - set(self.uavs)):
            raise ValueError(f"vehicles: {', '.join(sorted(unknown))} are neither transmitters nor receivers")
        if self.vehicles is not None and (problems := clashes(self.vehicles, self.mavlink)):
            raise ValueError(f"vehicles: {'; '.join(problems)}")
        if strangers := self.sensor.strangers(self.receivers, self.transmitters):
            raise ValueError(f"sensor.faults: {', '.join(strangers)} is nobody of this playbook")
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
            objective=self.planner.objective,
            bearing_sigma_rad=math.radians(self.sensor.sigma_deg),
            samples=self.planner.samples,
            start_sigma_m=self.planner.start_sigma_m,
            heading_referenced=self.sensor.reference == "true_north",
            tolerance_3sigma_m=self.planner.tolerance_3sigma_m,
            max_leg_m=self.planner.max_leg_m,
            fence=tuple(self.planner.fence),
            ground_transmitters=frozenset(self.beacons),
        )

    def plan(self, min_separation_m: float | None = None) -> RelayPlan:
        """Return the relay plan of this playbook, by its own method. PlannerError when there is none."""
        return METHODS[self.planner.method](self.problem(min_separation_m))
