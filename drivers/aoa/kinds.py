"""The kinds of AOA sensors that can be run on a UAV's companion computer, by name."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, Protocol

import msgspec

from drivers.aoa.krakensdr import KrakenSettings
from drivers.aoa.replay import ReplaySettings
from drivers.aoa.sensor import Sensor
from drivers.clock import Clock
from drivers.errors import SensorError


class SensorSettings(Protocol):
    """What a kind of sensor has to be told, as a msgspec struct; nothing is opened before `Sensor.run`."""

    def open(self, clock: Clock) -> Sensor:
        """Return the sensor."""
        ...


SENSORS: Final[Mapping[str, type[SensorSettings]]] = MappingProxyType(
    {
        "krakensdr": KrakenSettings,
        "replay": ReplaySettings,
    }
)


def read_settings(kind: str, values: Any) -> SensorSettings:
    """Return the settings of a kind from plain values. SensorError says which value is wrong and how."""
    try:
        settings: SensorSettings = msgspec.convert(values, SENSORS[kind], strict=True)
    except (msgspec.ValidationError, UnicodeEncodeError) as error:
        raise SensorError(f"{kind}: {error}") from error
    return settings
