"""Keys say whose they are, and nothing else does."""

import pytest

from drivers.bus.keys import SwarmKeys, uav_of
from tests.fakes import matches

KEYS = SwarmKeys("paper-8")


@pytest.mark.parametrize("kind", ["bearings", "position", "emission", "sensor_fault", "clock_ping", "clock_pong"])
def test_a_uavs_key_names_it_and_is_covered_by_the_key_of_all(kind):
    key = getattr(KEYS, kind)("U1.left")
    assert uav_of(key) == "U1.left"
    assert matches(getattr(KEYS, f"every_{kind}"), key)
    assert not matches(getattr(SwarmKeys("other"), f"every_{kind}"), key)


def test_the_keys_are_those_the_uavs_are_told():
    assert KEYS.bearings("U1") == "bearing-relay/paper-8/uav/U1/bearings"
    assert KEYS.position("U1") == "bearing-relay/paper-8/uav/U1/position"
    assert KEYS.emission("U1") == "bearing-relay/paper-8/uav/U1/emission"
    assert KEYS.progress == "bearing-relay/paper-8/relay/progress"
    assert KEYS.control == "bearing-relay/paper-8/relay/control"


@pytest.mark.parametrize(
    "key",
    [
        "",
        "bearing-relay",
        KEYS.progress,
        KEYS.control,
        "bearing-relay/paper-8/uav/U1",
        "bearing-relay/paper-8/uav//bearings",
        "bearing-relay/paper-8/uav/*/bearings",
        "bearing-relay/paper-8/uav/U1/bearings/more",
        "other/paper-8/uav/U1/bearings",
        "bearing-relay/a/b/uav/U1/bearings",
        "bearing-relay/paper-8/uav/-U1/bearings",
        "bearing-relay/paper-8/uav/U1/bearings\n",
    ],
)
def test_a_key_that_speaks_for_no_uav_names_none(key):
    assert uav_of(key) is None
