"""Telling a stop monitor what another one of its kind was told, so that both know the same."""

from __future__ import annotations

from gcs.relay.leg_filter import Whereabouts
from gcs.stop_monitor import StopMonitor
from gcs.traced_monitor import MonitorNote


def retell(monitor: StopMonitor, note: MonitorNote) -> tuple[Whereabouts, bool] | None:
    """Tell a monitor one thing; return where it finds the receiver and whether it arrived, when it was asked that.

    What it was made of is not told: it has been made of the same.
    """
    if note.begun:
        monitor.begin(note.time_s)
    elif note.observed is not None:
        told = note.observed
        monitor.observe(note.time_s, told.directions_rad, told.sigma_rad, told.resolution_rad)
    elif note.commanded_mps is not None:
        monitor.commanded(note.time_s, complex(*note.commanded_mps))
    elif note.asked is not None:
        now = monitor.whereabouts(note.time_s)
        return now, monitor.arrived(now)
    return None
