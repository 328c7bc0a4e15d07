"""What a page that has just been opened is told of the past of the run; from then on it follows the live socket."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec

from drivers.bus.run_messages import Place, RunEvent
from gcs.monitor.client import RunClient
from gcs.monitor.history import AngleSample


class LegAngles(msgspec.Struct, frozen=True):
    """The subtended angle over the leg that a receiver flew last: (s since the run began, rad)."""

    number: int
    stop_angle_rad: float
    band_rad: float
    samples: list[tuple[float, float]]


class Past(msgspec.Struct, frozen=True):
    """The past of a run as far as it was heard."""

    run: str | None
    tracks: dict[str, Sequence[Place]]
    angles: dict[str, LegAngles]
    spans: dict[str, list[tuple[float, str]]]
    """Of every receiver: since when it was in which state, s since the run began."""
    events: Sequence[RunEvent]


def past_of(client: RunClient) -> Past:
    """Return the past of the run that a client follows."""
    history = client.history
    return Past(
        run=None if client.state is None else client.state.run,
        tracks={name: list(track) for name, track in history.tracks.items()},
        angles={name: _last_leg(list(samples)) for name, samples in history.angles.items() if samples},
        spans={name: [(span.from_s, span.state) for span in history.spans(name)] for name in _receivers(client)},
        events=list(client.events),
    )


def _receivers(client: RunClient) -> list[str]:
    return [] if client.state is None else [receiver.name for receiver in client.state.receivers]


def _last_leg(samples: list[AngleSample]) -> LegAngles:
    last = samples[-1]
    same = [one for one in samples if (one.leg, one.stop_angle_rad) == (last.leg, last.stop_angle_rad)]
    points = [(one.elapsed_s, one.angle_rad) for one in same]
    return LegAngles(last.leg, last.stop_angle_rad, last.band_rad, points)
