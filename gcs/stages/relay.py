"""`relay`: the receivers are brought to their slots."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from drivers.bus.messages import Progress, encode
from drivers.bus.run_messages import Level
from gcs.control import ControlDesk
from gcs.playbook.stages import Relay
from gcs.recording.journal import change_line
from gcs.relay.executor import RelayExecutor
from gcs.relay.records import ReceiverRecord
from gcs.relay.states import HALTED, ReceiverState
from gcs.resume.beginning import go_on
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run, StageError
from planner.plan import Route
from planner.relay import wave_durations_s

_LEGS: Final = {ReceiverState.LEG_1: 1, ReceiverState.LEG_2: 2}

CREEP_S: Final = 1.5
"""What a leg takes longer because it is slowed as its angle closes."""


async def do(run: Run, _stage: Relay) -> None:
    """Fly the relay to its end; StageError when it has not formed."""
    run.require_in_flight()
    await fly(run, executor_of(run))


def executor_of(run: Run) -> RelayExecutor:
    """Return the relay of a run as its plan has it, or as an earlier service left it."""
    relay = RelayExecutor(
        run.records,
        {name: transmitter.at for name, transmitter in run.playbook.transmitters.items()},
        leases={name: member.stream for name, member in run.members.items()},
        feed=run.feed,
        emission=run.emission,
        frame=run.playbook.site.frame,
        clock=run.clock,
        settings=run.settings,
        objection=run.safety().objection,
        announce=announcer(run),
        say=run.tell,
        problem=run.playbook.problem(),
        trace=run.trace,
        attended=run.operator.attended,
        unverified=() if run.resumed is None else run.resumed.unverified,
    )
    if run.resumed is not None:
        go_on(relay, run.resumed, announcer(run))
    return relay


async def fly(run: Run, relay: RelayExecutor) -> None:
    """Fly a relay, the operator's word in force, and return when the last zero velocities have gone out."""
    run.relay = run.status.relay = relay
    run.operator.desk, run.halt = ControlDesk(relay, run.tell), relay.abort
    try:
        await relay.run()
    finally:
        run.halt = None
        await run.clock.sleep(run.playbook.flight.lease_s)
        run.placement_errors_m = {name: run.score.placement_error_m(record) for name, record in run.records.items()}
    if not relay.formed:
        left = [record for record in run.records.values() if record.state is not ReceiverState.PLACED]
        raise StageError(relay.held or "not formed: " + ", ".join(f"{each.name} {each.state.value}" for each in left))


def announcer(run: Run) -> Callable[[ReceiverRecord], None]:
    """Return what tells journal, bus and screen of every change of a receiver."""

    def announce(record: ReceiverRecord) -> None:
        run.status.on_air = run.emission.on_air
        told = f"{record.name} {record.state.value}" + (f": {record.reason}" if record.reason else "")
        state, slowed = record.state, record.leg is not None and bool(record.reason)
        level: Level = "alert" if state in HALTED else "warning" if slowed else "info"
        run.status.say(told, level=level, vehicle=record.name, leg=_LEGS.get(state), state=state.value)
        now_ns = run.clock.unix_ns()
        run.journal.append(change_line(now_ns, record))
        progress = Progress(now_ns, record.name, record.state.value, record.reason)
        run.bus.put_history(run.keys.progress, encode(progress))

    return announce


def foresee(outlook: Outlook, _stage: Relay) -> Foreseen:
    """Return what would be done: wave after wave, as planned, with what each placement may be off."""
    settings, plan = outlook.settings, outlook.plan
    standing_s = outlook.hearing_s(settings.locate_samples + settings.verify_samples) + settings.settle_s
    total_s, emission_s, parts = 0.0, 0.0, list[str]()
    for wave, flown_s in wave_durations_s(outlook.problem, plan.routes).items():
        routes = [route for route in plan.routes if route.wave == wave]
        lasts_s = flown_s + standing_s + CREEP_S * max(len(route.legs) for route in routes)
        on_air = outlook.kept_on.union(*(route.transmitters for route in routes))
        parts += [f"wave {wave}, {lasts_s:.0f} s, on the air {', '.join(sorted(on_air))}", *map(_route, routes)]
        total_s, emission_s = total_s + lasts_s, emission_s + lasts_s * len(on_air)
    words = f"{plan.total_length_m:.1f} m to be flown by {len(plan.routes)}"
    return Foreseen(words, total_s, tuple(parts), emission_s)


def _route(route: Route) -> str:
    legs = ", then ".join(f"{leg.length_m:.1f} m {leg.direction} {leg.guide}" for leg in route.legs) or "stays"
    off = "" if route.predicted_3sigma_m is None else f"; 3 sigma {route.predicted_3sigma_m:.2f} m"
    return f"  {route.receiver} to {route.slot}: {legs}{off}"
