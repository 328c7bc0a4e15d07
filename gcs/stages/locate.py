"""`locate`: where every receiver is, from bearings, before the relay."""

from __future__ import annotations

from collections.abc import Callable

from gcs.errors import HoldRequiredError
from gcs.playbook.stages import Locate
from gcs.relay.journey import Journey, Surroundings
from gcs.relay.records import ReceiverRecord
from gcs.relay.standing import Standing
from gcs.stages.outlook import Foreseen, Outlook
from gcs.stages.run import Run, StageError
from gcs.stages.together import all_of


async def do(run: Run, _stage: Locate) -> None:
    """Locate every receiver by the transmitters that are there from the start. StageError for those it cannot."""
    run.require_in_flight()
    safety = run.safety()
    standing = Standing({name: transmitter.at for name, transmitter in run.playbook.transmitters.items()})
    frame, problem = run.playbook.site.frame, run.playbook.problem()
    around = Surroundings(standing, run.emission, frame, run.clock, run.settings, problem, lambda _record: None)
    await all_of(_locate(run, record, around, safety.objection) for record in run.records.values())


async def _locate(
    run: Run, record: ReceiverRecord, around: Surroundings, objection: Callable[[str], str | None]
) -> None:
    name = record.name
    try:
        with run.feed.listen(name) as observations:
            lease = run.members[name].stream
            journey = Journey(record, around, lease, observations, lambda: objection(name), again=False, hovering={})
            fix = await journey.whereabouts()
    except HoldRequiredError as problem:
        raise StageError(f"{name} is not located: {problem.reason}") from problem
    finally:
        run.emission.need(name, ())
        run.status.on_air = run.emission.on_air
    run.located[name] = fix.position
    off_m = abs(fix.position - record.route.start)
    run.tell(f"{name} is located at {fix.position.real:.1f}, {fix.position.imag:.1f} m, {off_m:.1f} m from its start")


def foresee(outlook: Outlook, _stage: Locate) -> Foreseen:
    """Return what would be done."""
    lasts_s = outlook.hearing_s(outlook.settings.locate_samples)
    names, on_air = ", ".join(outlook.playbook.receivers), max(2, len(outlook.kept_on))
    return Foreseen(f"located from bearings: {names}", lasts_s, (), lasts_s * on_air)
