"""Formation frame <-> site frame <-> WGS84.

The formation frame is the paper's: origin at L0, x towards L1, y to its left. The site frame is local north-east-down
at one WGS84 origin shared by all vehicles, here L0's place. A horizontal site position is the complex number
north + i east, so that its argument is an azimuth.
"""

from __future__ import annotations

import cmath
from dataclasses import dataclass

import pymap3d


@dataclass(frozen=True)
class FormationFrame:
    """The formation frame, tied to the site by the azimuth of its x axis, rad."""

    axis_azimuth_rad: float

    def to_site(self, point: complex) -> complex:
        """Return north + i east, m, of a formation point, m.

        With psi the azimuth of x: x-hat = (cos psi, sin psi), y-hat = (sin psi, -cos psi) in (north, east).
        """
        return cmath.exp(1j * self.axis_azimuth_rad) * point.conjugate()

    def from_site(self, north_east: complex) -> complex:
        """Return the formation point, m, of a site position north + i east, m."""
        return cmath.exp(1j * self.axis_azimuth_rad) * north_east.conjugate()

    def azimuth_rad(self, direction_rad: float) -> float:
        """Return the azimuth of a polar direction, or the polar direction of an azimuth: the map is its own inverse."""
        return self.axis_azimuth_rad - direction_rad


@dataclass(frozen=True)
class GeodeticPosition:
    """A place on WGS84: degrees, and metres above mean sea level (the geoid is taken as the ellipsoid)."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float


@dataclass(frozen=True)
class SiteFrame:
    """Local north-east-down axes at `origin`."""

    origin: GeodeticPosition

    def to_geodetic(self, north_east: complex, down_m: float = 0.0) -> GeodeticPosition:
        """Return the WGS84 position of a site position: north + i east, m, and down, m."""
        latitude, longitude, altitude = pymap3d.ned2geodetic(
            north_east.real, north_east.imag, down_m, *self._origin_tuple()
        )
        return GeodeticPosition(float(latitude), float(longitude), float(altitude))

    def from_geodetic(self, position: GeodeticPosition) -> tuple[complex, float]:
        """Return (north + i east, down), m, of a WGS84 position."""
        north, east, down = pymap3d.geodetic2ned(
            position.latitude_deg, position.longitude_deg, position.altitude_m, *self._origin_tuple()
        )
        return complex(float(north), float(east)), float(down)

    def _origin_tuple(self) -> tuple[float, float, float]:
        return self.origin.latitude_deg, self.origin.longitude_deg, self.origin.altitude_m
