"""The local frame against an independent geodetic library."""

import pymap3d
import pytest

from drivers.simulation.geodesy import GeoPoint, LocalFrame


@pytest.mark.parametrize("latitude_deg", [-60.0, -35.363262, 0.0, 47.4, 69.0])
@pytest.mark.parametrize(("north_m", "east_m"), [(0, 0), (10, -20), (1000, 0), (0, 1000), (-800, 900)])
def test_places_agree_with_the_ellipsoid(latitude_deg, north_m, east_m):
    frame = LocalFrame(GeoPoint(latitude_deg, 149.165237, 0.0))
    place_deg = frame.to_degrees(north_m, east_m)
    back_m = pymap3d.geodetic2enu(*place_deg, 0.0, latitude_deg, 149.165237, 0.0)
    assert (back_m[1], back_m[0]) == pytest.approx((north_m, east_m), abs=2e-3)
    assert frame.to_metres(*place_deg) == pytest.approx((north_m, east_m), abs=1e-4)
