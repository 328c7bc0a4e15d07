"""How a run that goes on begins: its vehicles as they fly, its receivers as the journal has them, its stages left."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final

from gcs.errors import ServiceError
from gcs.fleet import Member, stream_for
from gcs.playbook.stage_rules import NamedStage
from gcs.recording.journal import FILE
from gcs.recording.journal_reading import Entry, StageChange, read_journal
from gcs.resume.adoption import found_in_the_air, member_as_it_flies
from gcs.resume.beginning import silence
from gcs.resume.earlier import read_earlier
from gcs.resume.state import restored, run_state
from gcs.stages.run import Run

_REPEATED: Final = frozenset({"emission"})
"""What is done again of the stages before the relay: it moves nobody."""


@dataclass(frozen=True)
class Resumption:
    """What the operator says of a run that goes on: the vehicles to do `without`."""

    without: frozenset[str] = frozenset()

    async def begin(self, run: Run) -> list[NamedStage]:
        """Restore a run from its journal and return the stages that are left of it. Nobody is moved.

        ServiceError when the run cannot go on: it never flew, or not enough of it is in the air.
        """
        read = read_journal(run.folder.path / FILE)
        for lost in read.lost:
            run.status.say(f"{FILE}: {lost}")
        state, stages = run_state(read.entries), stages_left(run.playbook.flow, read.entries)
        self._require_known(run)
        run.earlier = read_earlier(run.folder.path, run.clock.unix_ns())
        silence(run.bus, run.keys, {**run.playbook.uavs, **run.playbook.beacons})
        run.status.phase = "looking who flies"
        vehicles = run.fleet.vehicles
        found = await found_in_the_air(run.playbook, run.plan, vehicles, self.without | state.given_up, run.status.say)
        reasons = dict.fromkeys(self.without, "done without since the run was resumed")
        run.resumed = restored(run.plan, state, {**reasons, **found.grounded})
        run.records.clear()
        run.records |= run.resumed.records
        run.autopilots = found.autopilots
        for name, autopilot in found.autopilots.items():
            withheld = name in run.resumed.withheld
            if name in run.elsewhere:
                await run.elsewhere[name].adopt(withheld=withheld)
                run.members[name] = Member(vehicles[name], autopilot, run.elsewhere[name])
            else:
                run.members[name] = member_as_it_flies(
                    vehicles[name], autopilot, run.playbook.flight, run.clock, withheld=withheld
                )
            run.start(stream_for(run.members[name]))
        return stages

    def _require_known(self, run: Run) -> None:
        everyone = {**run.playbook.transmitters, **run.playbook.receivers}
        if strangers := sorted(self.without - everyone.keys()):
            raise ServiceError(f"--without {', '.join(strangers)}: nobody of this playbook, but {', '.join(everyone)}")


def stages_left(flow: Iterable[NamedStage], entries: Iterable[Entry]) -> list[NamedStage]:
    """Return what is left of the stages: the relay, and what comes after it and was not done. ServiceError without one.

    Nothing that comes before the relay is done again but switching transmitters.
    """
    stages = list(flow)
    relay = next((number for number, stage in enumerate(stages) if stage.kind == "relay"), None)
    if relay is None:
        raise ServiceError("the playbook has no relay: there is nothing to resume, fly it anew")
    done = {entry.stage for entry in entries if isinstance(entry, StageChange) and entry.state == "done"}
    before = [stage for stage in stages[:relay] if stage.kind in _REPEATED and stage.name in done]
    return [*before, stages[relay], *(stage for stage in stages[relay + 1 :] if stage.name not in done)]
