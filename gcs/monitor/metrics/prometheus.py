"""A run as Prometheus metrics. They are told when they are asked for, from the latest state."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final

from prometheus_client import CollectorRegistry, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import CONTENT_TYPE_LATEST, generate_latest
from prometheus_client.registry import Collector

from drivers.bus.run_messages import Histogram as RunHistogram
from drivers.bus.run_messages import LegState, LinkHealth, ReceiverStatus, RunState, VehicleState
from gcs.monitor.client import RunClient
from gcs.relay.states import ReceiverState

CONTENT_TYPE: Final = CONTENT_TYPE_LATEST
_PREFIX: Final = "bearing_relay_"
_LATENCIES_S: Final = (0.005, 0.01, 0.025, 0.05, 0.1, 0.2, 0.3, 0.5, 1.0, 2.0)

_Samples = Sequence[tuple[tuple[str, ...], float]]


def _on_leg(value_of: Callable[[LegState], float | None]) -> Callable[[ReceiverStatus], float | None]:
    return lambda receiver: None if receiver.leg is None else value_of(receiver.leg)


_OF_RECEIVER: Final[Mapping[str, tuple[str, Callable[[ReceiverStatus], float | None]]]] = MappingProxyType(
    {
        "receiver_to_go_seconds": ("Until it stands in its slot.", lambda r: r.to_go_s),
        "receiver_bearing_age_seconds": ("Since its latest good bearings were captured.", lambda r: r.bearings.age_s),
        "receiver_bearing_sigma_radians": ("Worst standard deviation in them.", lambda r: r.bearings.sigma_rad),
        "leg_angle_radians": ("Subtended angle of the stop reference.", _on_leg(lambda leg: leg.angle_rad)),
        "leg_stop_angle_radians": ("Where the leg ends.", _on_leg(lambda leg: leg.stop_angle_rad)),
        "leg_remaining_metres": ("To the leg's end, from angles alone.", _on_leg(lambda leg: leg.remaining_m)),
        "leg_cross_track_metres": ("Off its line, to the left.", _on_leg(lambda leg: leg.cross_track_m)),
    }
)
_OF_VEHICLE: Final[Mapping[str, tuple[str, Callable[[VehicleState], float | None]]]] = MappingProxyType(
    {
        "vehicle_armed": ("Whether it is armed.", lambda v: float(v.armed)),
        "vehicle_pilot": ("Whether its pilot has it.", lambda v: float(v.pilot)),
        "vehicle_silent_seconds": ("Since anything was heard of it.", lambda v: v.silent_s),
        "vehicle_height_metres": ("Above its home.", lambda v: v.height_m),
        "vehicle_battery_percent": ("What is left of its battery.", lambda v: v.battery_percent),
        "vehicle_battery_volts": ("Voltage of its battery.", lambda v: v.battery_v),
        "vehicle_nearest_metres": ("To the nearest other vehicle.", lambda v: v.nearest_m),
    }
)


class RunMetrics:
    """The metrics of whatever run a client follows."""

    def __init__(self, client: RunClient) -> None:
        self._registry = CollectorRegistry(auto_describe=False)
        self._registry.register(_RunCollector(client))
        self._latency = Histogram(
            f"{_PREFIX}state_latency_seconds",
            "From when the service told a state to when it came here, by the machine's clock.",
            buckets=_LATENCIES_S,
            registry=self._registry,
        )
        client.on_state.append(self._take)

    def text(self) -> bytes:
        """Return all metrics in Prometheus' text format."""
        return generate_latest(self._registry)

    def _take(self, state: RunState) -> None:
        self._latency.observe(max(time.time_ns() - state.sent_ns, 0) * 1e-9)


class _RunCollector(Collector):
    def __init__(self, client: RunClient) -> None:
        self._client = client

    def collect(self) -> Iterator[Metric]:
        client, state = self._client, self._client.state
        yield _gauge("up", "Whether the run is being heard of now.", float(not client.lost))
        yield _counter("malformed_messages", "Messages about the run that could not be read.", client.malformed)
        age_s = client.age_s()
        if state is None or age_s is None:
            return
        yield _gauge("state_age_seconds", "Since the latest state came.", age_s)
        yield from _of_run(state)
        yield from _of_receivers(state.receivers)
        yield from _of_vehicles(state.vehicles)
        yield from _of_links(state.links)
        if state.decisions is not None:
            yield _histogram(state.decisions)


def _of_run(state: RunState) -> Iterator[Metric]:
    yield _labelled("run_info", "The run.", ("run", "phase"), [((state.run, state.phase), 1.0)])
    yield _gauge("elapsed_seconds", "Since the run began.", state.elapsed_s)
    if state.to_go_s is not None:
        yield _gauge("to_go_seconds", "Until every receiver stands in its slot, as planned.", state.to_go_s)
    yield _gauge("held", "Whether the relay holds.", float(state.held is not None))
    yield _gauge("waiting", "Whether it waits for the operator.", float(state.waiting or state.asked is not None))
    yield _gauge("transmitters_on_air", "How many transmitters emit.", len(state.on_air))
    levels = [((level,), float(sum(each.level == level for each in state.alerts))) for level in ("alert", "warning")]
    yield _labelled("alerts", "What is wrong now.", ("level",), levels)
    yield _counter("events", "What has happened in the run.", state.events)
    yield _gauge("bus_connected", "Whether the service reaches the bus router.", float(state.bus.connected))
    yield _counter("bus_strangers", "Bearing reports of nobody in this run.", state.bus.strangers)
    yield _gauge("recording_good", "Whether everything is written down.", float(not state.recording.problem))
    yield _counter("recording_dropped", "Messages missing in the recording.", state.recording.dropped)


def _of_receivers(receivers: list[ReceiverStatus]) -> Iterator[Metric]:
    yield _labelled(
        "receivers",
        "How many receivers are in each state.",
        ("state",),
        [((each.value,), float(sum(r.state == each.value for r in receivers))) for each in ReceiverState],
    )
    for name, (help_text, of_receiver) in _OF_RECEIVER.items():
        values = [((each.name,), of_receiver(each)) for each in receivers]
        yield _labelled(
            name, help_text, ("receiver",), [(label, value) for label, value in values if value is not None]
        )
    received = [((each.name,), float(each.bearings.received)) for each in receivers]
    yield _labelled_counter("bearing_reports", "Bearing reports that came.", ("receiver",), received)
    yield _labelled_counter(
        "bearing_reports_dropped",
        "Bearing reports that were no good, by what was wrong.",
        ("receiver", "problem"),
        [((each.name, what), float(count)) for each in receivers for what, count in each.bearings.dropped.items()],
    )


def _of_vehicles(vehicles: list[VehicleState]) -> Iterator[Metric]:
    for name, (help_text, of_vehicle) in _OF_VEHICLE.items():
        values = [((each.name,), of_vehicle(each)) for each in vehicles]
        known = [(label, value) for label, value in values if value is not None]
        yield _labelled(name, help_text, ("vehicle",), known)


def _of_links(links: list[LinkHealth]) -> Iterator[Metric]:
    labels = ("link", "vehicles")
    named = [((link.address, link.vehicles), link) for link in links]
    yield _labelled(
        "link_up", "Whether it is up.", labels, [(label, float(link.state == "up")) for label, link in named]
    )
    losses = [(label, link.loss) for label, link in named if link.loss is not None]
    yield _labelled("link_loss_ratio", "Share of the last ten seconds' frames that were lost.", labels, losses)
    silences_s = [(label, link.silent_s) for label, link in named if link.silent_s is not None]
    yield _labelled("link_silent_seconds", "Since anything was heard.", labels, silences_s)
    for kind in ("received", "sent", "lost", "refused", "dropped"):
        counts = [(label, float(getattr(link, kind))) for label, link in named]
        yield _labelled_counter(f"link_frames_{kind}", f"Frames {kind}.", labels, counts)


def _gauge(name: str, help_text: str, value: float) -> Metric:
    return GaugeMetricFamily(_PREFIX + name, help_text, value=value)


def _counter(name: str, help_text: str, value: float) -> Metric:
    return CounterMetricFamily(_PREFIX + name, help_text, value=value)


def _labelled(name: str, help_text: str, labels: tuple[str, ...], samples: _Samples) -> Metric:
    family = GaugeMetricFamily(_PREFIX + name, help_text, labels=labels)
    for values, value in samples:
        family.add_metric(values, value)
    return family


def _labelled_counter(name: str, help_text: str, labels: tuple[str, ...], samples: _Samples) -> Metric:
    family = CounterMetricFamily(_PREFIX + name, help_text, labels=labels)
    for values, value in samples:
        family.add_metric(values, value)
    return family


def _histogram(told: RunHistogram) -> Metric:
    bounds = [*(f"{bound_s:g}" for bound_s in told.bounds_s), "+Inf"]
    buckets = [(bound, float(count)) for bound, count in zip(bounds, told.counts, strict=True)]
    help_text = "From the capture of a bearing to the stop monitor's decision on it."
    return HistogramMetricFamily(f"{_PREFIX}decision_seconds", help_text, buckets=buckets, sum_value=told.sum_s)
