"""What did not go as it should in a run, each on a line: for the top of its report."""

from __future__ import annotations

from collections import defaultdict
from typing import Final

from gcs.reports.markup import Content, element
from gcs.reports.run_data import RunData

_PLACED: Final = "PLACED"


def complaints(data: RunData) -> Content:
    """Return what did not go as it should, each on a line."""
    found = _unplaced(data)
    if data.result is None:
        found.append("the service ended before its report: this is what it had recorded until then")
    if data.traffic is not None and data.traffic.stopped is not None:
        found.append(f"flight.mcap is not complete: {data.traffic.stopped}")
    if data.traffic is not None and data.traffic.dropped:
        found.append(
            f"flight.mcap is not complete: {data.traffic.dropped} messages came faster than the disk took them"
        )
    if data.result is not None and data.result.refused_on_bus.total:
        found.append(str(data.result.refused_on_bus))
    missing = [name for name in data.missing if name != "report.json"]
    if missing:
        found.append(f"not in the folder: {', '.join(missing)}")
    return element("ul", [element("li", text) for text in found], class_="complaints") if found else ""


def _unplaced(data: RunData) -> list[str]:
    """Return why receivers are not PLACED, and why stages failed; what many have in common is said once."""
    if data.result is None:
        return []
    together: dict[tuple[str, str], list[str]] = defaultdict(list)
    for receiver in data.result.receivers:
        if receiver.state != _PLACED and receiver.reason:
            together[receiver.state, receiver.reason].append(receiver.name)
    found = [f"{', '.join(names)} {state}: {reason}" for (state, reason), names in together.items()]
    told = [reason for _, reason in together]
    return found + [
        f"{stage.name} {stage.outcome}: {stage.reason}"
        for stage in data.result.stages
        if stage.reason and not any(reason in stage.reason for reason in told)
    ]
