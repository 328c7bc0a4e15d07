"""Where simulated sensors are: who stands where, who is on the air, and what is wrong with whom, told by the bus."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from drivers.bus.keys import uav_of
from drivers.bus.messages import Emission, PositionReport, SensorFault, decode

POSITION_FRESH_NS: Final = 1_000_000_000
"""A UAV whose position is older is not simulated on: it might be anywhere."""


@dataclass
class SensorField:
    """What the sensors know of the world: who stands where, who is on the air, and what is wrong with whom."""

    beacons: dict[str, complex]
    positions: dict[str, PositionReport] = field(default_factory=dict)
    on_air: dict[str, bool] = field(default_factory=dict)
    wrong: dict[str, SensorFault] = field(default_factory=dict)
    told: set[str] = field(default_factory=set)
    """The keys of emission and faults on which something has come since it was last asked for."""

    def heard(self, name: str, place: Mapping[str, complex]) -> dict[str, complex]:
        """Return the transmitters a receiver hears: everyone emitting but itself, and those that are muted."""
        return {other: at for other, at in place.items() if other != name and self._emits(other)}

    def _emits(self, name: str) -> bool:
        muted = name in self.wrong and self.wrong[name].muted
        return self.on_air.get(name, False) and not muted

    def places(self, now_ns: int) -> dict[str, complex]:
        """Return where everyone is now, site frame: the last fresh report, carried on with its velocity."""
        places = dict(self.beacons)
        for name, report in self.positions.items():
            age_ns = now_ns - report.time_ns
            if age_ns <= POSITION_FRESH_NS:
                velocity = complex(report.north_mps, report.east_mps)
                places[name] = complex(report.north_m, report.east_m) + velocity * age_ns * 1e-9
        return places

    def heading_rad(self, name: str) -> float:
        """Return where a UAV's nose points; north until it has said."""
        report = self.positions.get(name)
        return 0.0 if report is None or report.heading_rad is None else report.heading_rad

    def take_position(self, key: str, payload: bytes) -> None:
        """Note a PositionReport."""
        if (name := uav_of(key)) is not None:
            self.positions[name] = decode(payload, PositionReport)

    def take_emission(self, key: str, payload: bytes) -> None:
        """Note who is on the air."""
        if (name := uav_of(key)) is not None:
            self.on_air[name] = decode(payload, Emission).on
            self.told.add(key)

    def take_fault(self, key: str, payload: bytes) -> None:
        """Note what is wrong with a sensor or a transmitter."""
        if (name := uav_of(key)) is not None:
            self.wrong[name] = decode(payload, SensorFault)
            self.told.add(key)
