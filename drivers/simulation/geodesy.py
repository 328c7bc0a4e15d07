"""Where a vehicle's local north-east metres are on the WGS84 ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, degrees, radians, sin, sqrt, tan

SEMI_MAJOR_AXIS_M = 6378137.0
ECCENTRICITY_SQUARED = 6.69437999014e-3


@dataclass(frozen=True, slots=True)
class GeoPoint:
    """A place: WGS84 latitude and longitude, deg, and height above mean sea level, m."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


class LocalFrame:
    """North and east metres on the ground around an origin; to second order, mm at a kilometre."""

    def __init__(self, origin: GeoPoint) -> None:
        latitude_rad = radians(origin.latitude_deg)
        flattening = sqrt(1.0 - ECCENTRICITY_SQUARED * sin(latitude_rad) ** 2)
        self.origin = origin
        self._tan = tan(latitude_rad)
        self._cos = cos(latitude_rad)
        self._transverse_m = SEMI_MAJOR_AXIS_M / flattening
        self._meridian_m = SEMI_MAJOR_AXIS_M * (1.0 - ECCENTRICITY_SQUARED) / flattening**3

    def to_degrees(self, north_m: float, east_m: float) -> tuple[float, float]:
        """Return (latitude, longitude), deg, of a place in this frame."""
        bend = east_m * east_m * self._tan / (2.0 * self._transverse_m)
        latitude_rad = (north_m - bend) / self._meridian_m
        longitude_rad = east_m / (self._transverse_m * self._cos) * (1.0 + north_m * self._tan / self._transverse_m)
        return self.origin.latitude_deg + degrees(latitude_rad), self.origin.longitude_deg + degrees(longitude_rad)

    def to_metres(self, latitude_deg: float, longitude_deg: float) -> tuple[float, float]:
        """Return (north, east), m, of a place given in degrees; the inverse of `to_degrees`."""
        north_m = radians(latitude_deg - self.origin.latitude_deg) * self._meridian_m
        east_m = radians(longitude_deg - self.origin.longitude_deg) * self._transverse_m * self._cos
        for _ in range(3):
            back_lat_deg, back_lon_deg = self.to_degrees(north_m, east_m)
            north_m += radians(latitude_deg - back_lat_deg) * self._meridian_m
            east_m += radians(longitude_deg - back_lon_deg) * self._transverse_m * self._cos
        return north_m, east_m
