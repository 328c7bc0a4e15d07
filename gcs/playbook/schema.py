"""The schema of a playbook. Lengths in metres, angles in degrees, points in the formation frame."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
    ValidationInfo,
    WithJsonSchema,
    field_validator,
    model_validator,
)

from gcs.expectations import Expectations, require_known
from gcs.playbook.bus_section import BusSection
from gcs.playbook.formation import Formation
from gcs.playbook.links import Mavlink, VehicleEntry, VehicleLayer, VehicleLink, clashes, layered
from gcs.playbook.sections import Degrees, Metres, Name, Point, Section
from gcs.playbook.sensor_section import SensorSection
from gcs.playbook.stage_rules import (
    OF_A_SENSOR,
    OF_A_TRANSMITTER,
    OF_THE_ROUTER,
    ON_THE_LINK,
    Known,
    NamedStage,
    as_ever,
    named,
    stage_problems,
)
from gcs.playbook.stages import StageItem
from gcs.playbook.suggestions import Problem, refuse
from planner.frames import FormationFrame, GeodeticPosition
from planner.methods import DEFAULT_METHOD, METHODS
from planner.plan import RelayPlan
from planner.relay import Objective, RelayProblem


def _read_method(value: Any) -> str:
    if not isinstance(value, str) or value not in METHODS:
        raise ValueError(f"a planning method is one of {', '.join(METHODS)}")
    return value


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


LONGEST_PATIENCE_S = 60.0
"""The largest `flight.give_up_s`."""


class Flight(Section):
    """How the relay is flown."""

    altitude_m: Annotated[float, Field(ge=2.0, le=500.0)] = 20.0
    speed_mps: Annotated[float, Field(ge=0.5, le=10.0)] = 5.0
    placement_tolerance_m: Metres = 3.0
    lease_s: Annotated[float, Field(ge=0.1, le=1.0)] = 0.5
    give_up_s: Annotated[float, Field(ge=1.0, le=LONGEST_PATIENCE_S)] = 5.0
    land_after: bool = False


class Simulation(Section):
    """The air that simulated vehicles fly in."""

    wind_mps: Annotated[float, Field(ge=0.0, le=30.0)] = 0.0
    wind_from_deg: Degrees = 0.0
    gusts_mps: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0
    gps_noise_m: Annotated[float, Field(ge=0.0, le=20.0)] = 0.0


Target = Literal["embedded", "ardupilot", "px4", "vehicles"]
"""What a playbook flies on: embedded copters, an autopilot's own simulator, or the vehicles it names."""


class Playbook(Section):
    """A run: site, formation, UAVs, how to plan and fly, what is done one after another and what is expected."""

    playbook: Literal[1]
    name: Name
    slow: bool = False
    target: Target | None = None
    seed: Annotated[int, Field(ge=0, le=2**53)] = 0
    site: Site = Site()
    formation: Formation
    transmitters: Annotated[dict[Name, Transmitter], Field(min_length=2)]
    receivers: Annotated[dict[Name, Receiver], Field(min_length=1)]
    fleet: VehicleLayer = VehicleLayer()
    vehicle_types: dict[Name, VehicleLayer] = Field(default_factory=dict)
    vehicles: dict[Name, VehicleLink] | None = None
    planner: Planner = Planner()
    flight: Flight = Flight()
    sensor: SensorSection = SensorSection()
    bus: BusSection = BusSection()
    mavlink: Mavlink = Mavlink()
    simulation: Simulation = Simulation()
    stages: Annotated[list[StageItem], Field(min_length=1, max_length=200)] | None = None
    expect: Expectations = Field(default_factory=dict)
    matrix: dict[str, Annotated[list[Any], Field(min_length=1, max_length=100)]] = Field(default_factory=dict)
    """What to fly it with instead, one run for each combination: {"sensor.sigma_deg": [0.1, 0.5], seed: [1, 2]}."""

    @field_validator("vehicles", mode="before", json_schema_input_type=dict[Name, VehicleEntry] | None)
    @classmethod
    def _layered(cls, value: Any, info: ValidationInfo) -> Any:
        if not {"fleet", "vehicle_types"} <= info.data.keys():
            return None  # what is wrong there is said there
        return layered(value, info.data["fleet"], info.data["vehicle_types"])

    @field_validator("stages")
    @classmethod
    def _staged(cls, value: list[StageItem] | None, info: ValidationInfo) -> list[StageItem] | None:
        if value is not None and {"transmitters", "receivers"} <= info.data.keys():
            transmitters, receivers = info.data["transmitters"], info.data["receivers"]
            flying = [name for name, transmitter in transmitters.items() if not transmitter.beacon]
            refuse(stage_problems(named(value), Known([*flying, *receivers], transmitters, receivers)))
        return value

    @model_validator(mode="after")
    def _consistent(self) -> Playbook:
        refuse(self._problems())
        clauses = [
            (("stages", number, stage.kind, "expect"), stage.settings.expect) for number, stage in enumerate(self.flow)
        ]
        require_known([*clauses, (("expect",), self.expect)], self.receivers, [stage.name for stage in self.flow])
        return self

    def _problems(self) -> Iterator[Problem]:
        if self.vehicles is not None and (missing := set(self.uavs) - self.vehicles.keys()):
            yield ("vehicles",), f"{', '.join(sorted(missing))} have no link (leave out 'vehicles' to simulate all)"
        if self.vehicles is not None and (unknown := self.vehicles.keys() - set(self.uavs)):
            yield ("vehicles",), f"{', '.join(sorted(unknown))} are neither transmitters nor receivers"
        if self.vehicles is not None and (problems := clashes(self.vehicles, self.mavlink)):
            yield ("vehicles",), "; ".join(problems)
        if self.nodes and self.bus.router is None:
            yield ("bus", "router"), "link nodes need a router that they can reach: name it"
        if self.target == "vehicles" and self.vehicles is None:
            yield ("target",), "there are no vehicles: name how each is reached, or fly on embedded"
        if strangers := self.sensor.strangers(self.receivers, self.transmitters):
            yield ("sensor", "faults"), f"{', '.join(strangers)} is nobody of this playbook"
        if self.stages is not None and self.flight.land_after:
            yield ("flight", "land_after"), "with stages, landing is one of them: leave it out and write `- land`"
        yield from self._injections()
        if (problem := self.bus.problem) is not None:
            yield ("bus", "router"), problem
        try:
            self.problem()
        except ValueError as error:
            yield (), str(error)

    def _injections(self) -> Iterator[Problem]:
        """Yield the faults that this playbook would inject into vehicles that it does not simulate."""
        flown_on = self.target or ("embedded" if self.vehicles is None else "vehicles")
        for number, entry in enumerate(self.stages or ()):
            if entry.inject is None:
                continue
            fault = entry.inject.fault
            if flown_on == "vehicles":
                yield ("stages", number, "inject"), "faults are injected into simulated vehicles only: see target"
            elif flown_on == "px4" and fault in ON_THE_LINK:
                yield ("stages", number, "inject", "fault"), f"{fault} needs a link of its own, which PX4's has not"
            elif fault in OF_A_SENSOR | OF_A_TRANSMITTER and self.sensor.simulated is False:
                yield ("stages", number, "inject", "fault"), f"{fault} needs simulated sensors: see sensor.simulated"
            elif fault in OF_THE_ROUTER and self.bus.router is not None:
                yield (
                    ("stages", number, "inject", "fault"),
                    "the bus router is not this run's own: leave out bus.router",
                )

    @property
    def flow(self) -> tuple[NamedStage, ...]:
        """What is done one after another."""
        return as_ever(land_after=self.flight.land_after) if self.stages is None else named(self.stages)

    @property
    def uavs(self) -> dict[str, complex]:
        """Every UAV and where it starts, formation frame, m; beacons are none."""
        standing = {name: transmitter.at for name, transmitter in self.transmitters.items() if not transmitter.beacon}
        return standing | {name: receiver.start for name, receiver in self.receivers.items()}

    @property
    def nodes(self) -> dict[str, str]:
        """The link node of every vehicle that is on one."""
        return {name: at.node for name, at in (self.vehicles or {}).items() if at.node is not None}

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
