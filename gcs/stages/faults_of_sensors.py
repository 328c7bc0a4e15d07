"""What is wrong with every simulated sensor and transmitter, told to their process whenever it changes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import reduce

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Ailment, SensorFault, encode
from drivers.bus.session import Bus
from gcs.playbook.stages import Inject

_PPM = 1e-6


@dataclass
class SensorFaults:
    """The faults that have struck and not ended, by whose sensor or transmitter they are."""

    bus: Bus
    keys: SwarmKeys
    _struck: dict[str, list[SensorFault]] = field(default_factory=dict)

    def switch(self, name: str, fault: SensorFault, *, on: bool) -> None:
        """Begin a fault, or end one that has begun; all others of this name go on."""
        struck = self._struck.setdefault(name, [])
        (struck.append if on else struck.remove)(fault)
        self.bus.put_reliably(self.keys.sensor_fault(name), encode(together(struck)))


def fault_of(stage: Inject) -> SensorFault:
    """Return what an `inject` stage does to a sensor, or to a transmitter."""
    ailments = []
    if stage.fault == "sensor_stuck":
        ailments = [Ailment(stage.fault)]
    elif stage.fault == "sensor_bias":
        ailments = [Ailment(stage.fault, math.radians(stage.bias_deg), stage.of)]
    elif stage.fault == "sensor_jump":
        ailments = [Ailment(stage.fault, math.radians(stage.jump_deg), stage.of)]
    elif stage.fault == "clock_step":
        ailments = [Ailment(stage.fault, stage.step_s)]
    elif stage.fault == "clock_drift":
        ailments = [Ailment(stage.fault, stage.drift_ppm * _PPM)]
    impaired = (stage.loss, stage.duplication, stage.reordering, stage.delay_s, stage.jitter_s)
    silent, muted = stage.fault == "sensor_silent", stage.fault == "transmitter_silent"
    return SensorFault(silent, muted, ailments, *impaired)


def together(faults: Sequence[SensorFault]) -> SensorFault:
    """Return what is wrong under all of these at once; of what befalls reports, the worst."""
    return reduce(_both, faults, SensorFault(silent=False))


def _both(one: SensorFault, other: SensorFault) -> SensorFault:
    return SensorFault(
        one.silent or other.silent,
        one.muted or other.muted,
        [*one.ailments, *other.ailments],
        max(one.loss, other.loss),
        max(one.duplication, other.duplication),
        max(one.reordering, other.reordering),
        max(one.delay_s, other.delay_s),
        max(one.jitter_s, other.jitter_s),
    )
