"""Counts what passed on the bus: how many messages on each key, how steadily, and how the sensors reported."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import msgspec

from drivers.bus.keys import uav_of
from drivers.bus.messages import BearingReport


@dataclass
class KeyTraffic:
    """The messages on one key; times in ns."""

    messages: int = 0
    unreadable: int = 0
    size_bytes: int = 0
    first_ns: int = 0
    last_ns: int = 0
    longest_gap_ns: int = 0

    def count(self, time_ns: int, size_bytes: int, *, readable: bool) -> None:
        """Take in one message."""
        if self.messages:
            self.longest_gap_ns = max(self.longest_gap_ns, time_ns - self.last_ns)
        else:
            self.first_ns = time_ns
        self.messages += 1
        self.unreadable += not readable
        self.size_bytes += size_bytes
        self.last_ns = time_ns

    def figures(self) -> dict[str, Any]:
        """Return the JSON form: Hz and s; null where there were too few messages to tell."""
        lasted_s = (self.last_ns - self.first_ns) * 1e-9
        return {
            "messages": self.messages,
            "unreadable": self.unreadable,
            "size_bytes": self.size_bytes,
            "rate_hz": (self.messages - 1) / lasted_s if lasted_s > 0.0 else None,
            "longest_gap_s": self.longest_gap_ns * 1e-9 if self.messages > 1 else None,
        }


@dataclass
class SensorTraffic:
    """The bearing reports of one receiver. Ages are from capture, by the sensor's clock, to arrival here."""

    reports: int = 0
    bearings: int = 0
    missing: int = 0
    """Reports that never came, by the gaps in their numbering."""
    age_sum_s: float = 0.0
    longest_age_s: float = 0.0
    _next: int | None = None

    def count(self, report: BearingReport, time_ns: int) -> None:
        """Take in one report."""
        age_s = (time_ns - report.captured_ns) * 1e-9
        self.longest_age_s = age_s if not self.reports else max(self.longest_age_s, age_s)
        self.age_sum_s += age_s
        self.reports += 1
        self.bearings += len(report.bearings)
        if self._next is not None and report.sequence > self._next:
            self.missing += report.sequence - self._next
        self._next = report.sequence + 1

    def figures(self) -> dict[str, Any]:
        """Return the JSON form, s."""
        return {
            "reports": self.reports,
            "bearings": self.bearings,
            "missing": self.missing,
            "mean_age_s": self.age_sum_s / self.reports,
            "longest_age_s": self.longest_age_s,
        }


@dataclass
class Traffic:
    """Everything that passed."""

    keys: dict[str, KeyTraffic] = field(default_factory=dict)
    sensors: dict[str, SensorTraffic] = field(default_factory=dict)

    def count(self, key: str, time_ns: int, size_bytes: int, message: msgspec.Struct | None, *, readable: bool) -> None:
        """Take in what came on a key, and the message it is when that is known."""
        self.keys.setdefault(key, KeyTraffic()).count(time_ns, size_bytes, readable=readable)
        if isinstance(message, BearingReport):
            self.sensors.setdefault(uav_of(key) or key, SensorTraffic()).count(message, time_ns)

    def figures(self) -> dict[str, Any]:
        """Return the JSON form."""
        return {
            "keys": {key: traffic.figures() for key, traffic in sorted(self.keys.items())},
            "sensors": {name: traffic.figures() for name, traffic in sorted(self.sensors.items())},
        }
