"""A report.json as runs leave it behind, for expectations to be judged by."""

from __future__ import annotations

from typing import Any


def leg(flown_m: float | None = 40.0, error_deg: float | None = 0.1) -> dict[str, Any]:
    return {
        "planned_length_m": 41.0, "flown_length_m": flown_m, "stop_angle_deg": 30.0,
        "stop_angle_error_deg": error_deg, "duration_s": 12.0,
    }  # fmt: skip


def receiver(name: str, state: str = "PLACED", error_m: float | None = 0.2, reason: str = "") -> dict[str, Any]:
    return {
        "name": name, "slot": f"O{name[1:]}", "state": state, "reason": reason, "route_model": "I",
        "transmitters": ["L0", "L1"], "placement_error_m": error_m, "legs": [leg(), leg(error_deg=-0.3)],
    }  # fmt: skip


def report(*receivers: dict[str, Any], **values: Any) -> dict[str, Any]:
    """A run of three receivers, unless they are given."""
    made = {
        "playbook": "three", "outcome": "formed", "planned_total_length_m": 200.0, "flown_total_length_m": 210.0,
        "straight_line_bound_m": 190.0, "min_separation_m": 7.5, "duration_s": 90.0, "emission_transmitter_s": 120.0,
        "bearing_reports": {"received": 900, "stale": 3, "stuck": 2},
        "links": [
            {"vehicles": "U1", "received": 900, "lost": 100}, {"vehicles": "U2", "received": 50, "lost": 0},
            {"vehicles": "U3", "received": 0, "lost": 0},
        ],
        "stages": [
            {"name": "relay", "kind": "relay", "outcome": "done", "began_s": 20.0, "ended_s": 80.0, "reason": ""},
            {"name": "hold", "kind": "hold", "outcome": "done", "began_s": 80.0, "ended_s": 85.0, "reason": ""},
            {"name": "land", "kind": "land", "outcome": "stopped", "began_s": 85.0, "ended_s": None, "reason": ""},
        ],
        "measurements": [
            {"stage": "measure", "receivers": {"U1": {"mean_m": 9.0, "max_m": 9.0}}},
            {"stage": "again", "receivers": {"U1": {"mean_m": 0.3, "max_m": 0.7}, "U2": {"mean_m": 0.2}}},
        ],
        "receivers": list(receivers) or [receiver("U1"), receiver("U2", error_m=0.4), receiver("U3", error_m=0.9)],
    }  # fmt: skip
    return {**made, **values}
