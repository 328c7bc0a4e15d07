"""Formation frame, site frame and WGS84 fit together."""

from __future__ import annotations

import cmath
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planner.angles import direction
from planner.frames import FormationFrame, GeodeticPosition, SiteFrame

points = st.complex_numbers(max_magnitude=1e4, allow_nan=False, allow_infinity=False)


def test_the_axes_lie_as_defined() -> None:
    psi = math.radians(30.0)
    frame = FormationFrame(psi)
    assert frame.to_site(1 + 0j) == pytest.approx(complex(math.cos(psi), math.sin(psi)))
    assert frame.to_site(1j) == pytest.approx(complex(math.sin(psi), -math.cos(psi)))


def test_counter_clockwise_seen_from_above() -> None:
    """With x pointing east, y points north."""
    assert FormationFrame(math.pi / 2).to_site(1j) == pytest.approx(1 + 0j, abs=1e-15)


@given(points, st.floats(-7.0, 7.0))
def test_there_and_back(point: complex, axis: float) -> None:
    frame = FormationFrame(axis)
    assert frame.from_site(frame.to_site(point)) == pytest.approx(point, abs=1e-8)


@given(points.filter(lambda z: abs(z) > 1e-3), st.floats(-7.0, 7.0))
def test_directions_turn_like_points(point: complex, axis: float) -> None:
    frame = FormationFrame(axis)
    azimuth = frame.azimuth_rad(direction(point))
    assert cmath.rect(abs(point), azimuth) == pytest.approx(frame.to_site(point), abs=1e-7)
    assert frame.azimuth_rad(azimuth) == pytest.approx(direction(point))


@pytest.mark.parametrize("latitude_deg", [-35.363262, 0.0, 60.0])
def test_site_and_wgs84_there_and_back(latitude_deg: float) -> None:
    site = SiteFrame(GeodeticPosition(latitude_deg, 149.165237, 584.0))
    position = site.to_geodetic(complex(120.0, -340.0), down_m=-20.0)
    north_east, down_m = site.from_geodetic(position)
    assert north_east == pytest.approx(complex(120.0, -340.0), abs=1e-6)
    assert down_m == pytest.approx(-20.0, abs=1e-6)


def test_a_degree_of_latitude_is_known() -> None:
    """At the equator one degree of latitude is 110.574 km on WGS84."""
    site = SiteFrame(GeodeticPosition(0.0, 0.0, 0.0))
    north_east, _ = site.from_geodetic(GeodeticPosition(0.001, 0.0, 0.0))
    assert north_east.real == pytest.approx(110.574, abs=1e-3)
    assert north_east.imag == pytest.approx(0.0, abs=1e-9)
