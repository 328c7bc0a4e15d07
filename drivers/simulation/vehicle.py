"""One simulated vehicle as its messages see it: who it is, where on Earth it flies and what time it is there."""

from __future__ import annotations

from zlib import crc32

from drivers.simulation.failsafe import GcsFailsafe
from drivers.simulation.flight import Flight
from drivers.simulation.geodesy import GeoPoint, LocalFrame

HOVER_CURRENT_A = 15.0


class Vehicle:
    """A flight with an identity, a place and a clock."""

    def __init__(self, name: str, flight: Flight, failsafe: GcsFailsafe, origin: GeoPoint, boot_unix_ns: int) -> None:
        self.flight = flight
        self.failsafe = failsafe
        self.frame = LocalFrame(origin)
        self.reboots = False
        """Whether a station has asked it to."""
        self.uid = crc32(name.encode()) << 32 | crc32(f"{name}/{origin}".encode())
        self._boot_unix_ns = boot_unix_ns

    @property
    def system_id(self) -> int:
        """The MAVLink system id."""
        return int(self.flight.parameters["SYSID_THISMAV"])

    @property
    def boot_ms(self) -> int:
        """Time since switch-on of the present state, ms."""
        return round(self.flight.time_s * 1000.0)

    @property
    def unix_us(self) -> int:
        """Time of the present state since 1970-01-01 UTC, us."""
        return self._boot_unix_ns // 1000 + round(self.flight.time_s * 1e6)

    def place_e7(self, north_m: float, east_m: float) -> tuple[int, int]:
        """Return (latitude, longitude) of a local place, 1e-7 deg."""
        latitude_deg, longitude_deg = self.frame.to_degrees(north_m, east_m)
        return round(latitude_deg * 1e7), round(longitude_deg * 1e7)

    @property
    def position_e7(self) -> tuple[int, int]:
        """(latitude, longitude) of the vehicle, 1e-7 deg."""
        dynamics = self.flight.dynamics
        return self.place_e7(dynamics.north.position_m, dynamics.east.position_m)

    @property
    def altitude_m(self) -> float:
        """Height of the vehicle above mean sea level, m."""
        return self.frame.origin.altitude_m + self.flight.dynamics.height_m

    @property
    def used_charge_mah(self) -> float:
        """Charge taken from the battery, mAh: hover current for as long as it was armed."""
        return self.flight.armed_s * HOVER_CURRENT_A / 3.6

    @property
    def battery_percent(self) -> int:
        """Charge left, percent."""
        return max(0, round(100.0 * (1.0 - self.used_charge_mah / self.flight.parameters["BATT_CAPACITY"])))
