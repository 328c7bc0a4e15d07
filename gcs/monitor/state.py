"""The state of a run at one moment, as every screen gets it."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

from drivers.bus.run_messages import ReceiverStatus, RunState
from gcs.monitor.alerts import alerts
from gcs.monitor.receiver_states import Since, receiver_states
from gcs.monitor.sources import RunSources
from gcs.monitor.vehicle_states import link_health, vehicle_states


@dataclass
class StateTeller:
    """Tells the state of one run, again and again."""

    sources: RunSources
    told: int = 0
    """How often it has."""
    _since: Since = field(default_factory=Since)

    def tell(self) -> RunState:
        """Return the state of the run now."""
        sources, status = self.sources, self.sources.status
        relay, clock = status.relay, status.clock
        links = status.links()
        receivers, vehicles = receiver_states(sources, self._since), vehicle_states(sources)
        bus, recording = sources.bus(), sources.recording()
        state = RunState(
            run=sources.setup.run,
            number=self.told,
            time_ns=clock.unix_ns(),
            sent_ns=time.time_ns(),
            phase=status.phase,
            elapsed_s=status.elapsed_s(),
            setup=sources.setup.number,
            alerts=alerts(sources, receivers, vehicles, bus, recording),
            held=None if relay is None else relay.held,
            waiting=relay is not None and relay.waiting,
            ways_out=relay.ways_out() if relay is not None and relay.waiting else [],
            asked=status.asked,
            to_go_s=_to_go_s(receivers),
            on_air=sorted(sources.transmitting()),
            taken=[] if relay is None else sorted(relay.taken),
            receivers=receivers,
            vehicles=vehicles,
            links=[link_health(names, link) for names, link in links],
            bus=bus,
            recording=recording,
            decisions=sources.decisions(),
            events=status.said,
        )
        self.told += 1
        return state


def _to_go_s(receivers: list[ReceiverStatus]) -> float | None:
    """Return in what time the last receiver stands in its slot; None while one of them does not go on by itself."""
    times_s = [receiver.to_go_s for receiver in receivers if receiver.state != "FAILED"]
    known_s = [time_s for time_s in times_s if time_s is not None]
    return max(known_s) if known_s and len(known_s) == len(times_s) else None
