"""How single figures are told by report.json, whole or the report so far: what is not in it was not measured."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

from gcs.expectations.condition import Value, is_number

Report = Mapping[str, Any]
ReadsOne = Callable[[Report], Value | None]
ReadsParts = Callable[[Report], dict[str, float]]


def plain(key: str) -> ReadsOne:
    """Return what reads a value that stands in the report as it is."""

    def read(report: Report) -> Value | None:
        value = report.get(key)
        return value if isinstance(value, str | bool) or is_number(value) else None

    return read


def of_receivers(key: str, *states: str) -> ReadsParts:
    """Return what reads a number of each receiver, or only of those in certain states."""

    def read(report: Report) -> dict[str, float]:
        found = {each["name"]: each.get(key) for each in _receivers(report) if not states or each["state"] in states}
        return {name: number for name, number in found.items() if is_number(number)}

    return read


def of_legs(key: str, gathered: Callable[[list[float]], float]) -> ReadsParts:
    """Return what gathers the size of a number of each leg of a receiver into one for the receiver."""

    def read(report: Report) -> dict[str, float]:
        found = {
            each["name"]: [abs(leg[key]) for leg in each.get("legs", ()) if is_number(leg.get(key))]
            for each in _receivers(report)
        }
        return {name: gathered(numbers) for name, numbers in found.items() if numbers}

    return read


def number_in(state: str) -> ReadsOne:
    """Return what counts the receivers in a state."""
    return lambda report: sum(each["state"] == state for each in _receivers(report))


def held_reason(report: Report) -> str:
    """Return why receivers are not PLACED, one after another; empty when all are."""
    reasons = [each["reason"] for each in _receivers(report) if each["state"] != "PLACED" and each["reason"]]
    return "; ".join(dict.fromkeys(reasons))


def length_ratio(report: Report) -> float | None:
    """Return the length flown to the length planned."""
    flown_m, planned_m = report.get("flown_total_length_m"), report.get("planned_total_length_m")
    return flown_m / planned_m if is_number(flown_m) and is_number(planned_m) and planned_m > 0.0 else None


def bearings_received(report: Report) -> Value | None:
    """Return how many bearing reports came."""
    return plain("received")(report.get("bearing_reports", {}))


def bearings_refused(report: Report) -> dict[str, float]:
    """Return how many bearing reports were refused, by what was wrong with them."""
    counts = report.get("bearing_reports", {})
    return {problem: count for problem, count in counts.items() if problem != "received" and is_number(count)}


def link_lost_share(report: Report) -> dict[str, float]:
    """Return the share of its messages that each link lost, by the vehicles behind it."""
    shares = {}
    for link in report.get("links", ()):
        received, lost = link.get("received"), link.get("lost")
        if is_number(received) and is_number(lost) and received + lost > 0:
            shares[str(link.get("vehicles"))] = lost / (received + lost)
    return shares


def stages_failed(report: Report) -> int:
    """Return how many stages have failed so far."""
    return sum(each.get("outcome") == "failed" for each in report.get("stages", ()))


def stage_durations_s(report: Report) -> dict[str, float]:
    """Return how long each stage that has ended lasted, s."""
    return {
        each["name"]: each["ended_s"] - each["began_s"]
        for each in report.get("stages", ())
        if is_number(each.get("began_s")) and is_number(each.get("ended_s"))
    }


def latest_measurement(key: str) -> ReadsParts:
    """Return what reads a number of each receiver from the latest measurement."""

    def read(report: Report) -> dict[str, float]:
        measurements = report.get("measurements") or [{}]
        found = {name: figures.get(key) for name, figures in measurements[-1].get("receivers", {}).items()}
        return {name: number for name, number in found.items() if is_number(number)}

    return read


def percentile(values: list[float], share: float) -> float:
    """Return the value that a share of the values does not exceed, between two of them in proportion."""
    ordered = sorted(values)
    at = share * (len(ordered) - 1)
    low = math.floor(at)
    high = min(low + 1, len(ordered) - 1)
    return ordered[low] + (at - low) * (ordered[high] - ordered[low])


def _receivers(report: Report) -> list[Mapping[str, Any]]:
    return list(report.get("receivers", ()))
