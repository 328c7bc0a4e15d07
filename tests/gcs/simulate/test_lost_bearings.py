"""Nothing flies on without bearings: what is commanded over time while reports are lost, for good or for a while."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

from drivers.bus.messages import BearingReport, decode
from drivers.tasks import background
from gcs.commands.options import changed
from gcs.playbook.loader import load_playbook
from gcs.playbook.schema import Playbook
from gcs.relay.states import ReceiverState
from gcs.simulate.bus import LocalBus
from gcs.simulate.outcome import fly_once
from gcs.simulate.scored import ScoredWorld
from gcs.simulate.virtual_time import VirtualClock, run_virtually
from tests.gcs.simulate.small import small

LOOK_S = 0.02
LOST = "sensor: {{sigma_deg: 0.1, drop_out: {drop_out}, faults: {{{faults}}}}}\n"


@dataclass
class Flown:
    """What a receiver was told in a relay, and what it heard."""

    formed: bool
    state: ReceiverState
    reason: str
    ended_s: float
    moved_m: float
    lease_s: float
    fresh_s: list[float] = field(default_factory=list)
    """When a report with bearings reached the service."""
    moving_s: list[float] = field(default_factory=list)
    """When its command, looked at 50 times a second, was not zero."""

    @property
    def latest_command_s(self) -> float:
        """How long after the latest fresh report it was still told to move, at most."""
        return max(now_s - max(s for s in self.fresh_s if s <= now_s) for now_s in self.moving_s)

    def gaps(self) -> list[tuple[float, float]]:
        """Return when no report came for longer than a second, and it had been told to move before."""
        return [(at, then) for at, then in pairwise(self.fresh_s) if then - at > 1.0 and self.moving_s[0] < at]


def fly(playbook: Playbook, seed: int = 1, *, silent: bool = False) -> Flown:
    """Fly a playbook with one receiver; with `silent` its sensor has never said anything."""
    return run_virtually(_fly(playbook, seed, silent))


async def _fly(playbook: Playbook, seed: int, silent: bool) -> Flown:
    clock = VirtualClock()
    world = ScoredWorld(playbook, playbook.plan(), clock, LocalBus(), seed=seed)
    u1, fresh_s, moving_s = world.vehicles["U1"], [], []
    start = u1.place
    world.silenced |= {"U1"} if silent else set()

    def heard(_: str, payload: bytes) -> bytes:
        if decode(payload, BearingReport).bearings:
            fresh_s.append(clock.now_s())
        return payload

    async def look() -> None:
        while True:
            u1.advance()
            if u1.command:
                moving_s.append(clock.now_s())
            await clock.sleep(LOOK_S)

    world.tamper = heard
    async with background(look()):
        await world.run(200.0)
        ended_s = clock.now_s()
        await world.hover(5.0)
    record = world.executor.records["U1"]
    assert u1.command == 0j
    assert abs(u1.velocity) < 0.05
    moved_m, lease_s = abs(u1.place - start), playbook.flight.lease_s
    return Flown(world.executor.formed, record.state, record.reason, ended_s, moved_m, lease_s, fresh_s, moving_s)


def test_without_any_bearing_it_never_moves_and_is_held(tmp_path: Path) -> None:
    playbook = small(tmp_path)
    flown = fly(playbook, silent=True)
    assert flown.fresh_s == []
    assert flown.moving_s == []
    assert flown.moved_m < 0.1
    assert (flown.formed, flown.state) == (False, ReceiverState.HELD)
    assert "0 of 10 reports with bearings of L0, L1" in flown.reason
    assert flown.ended_s < playbook.flight.give_up_s + 1.0


def test_reports_without_a_bearing_are_no_bearings(tmp_path: Path) -> None:
    flown = fly(small(tmp_path, LOST.format(drop_out=0.0, faults="bearing_drop_out: 1.0")))
    assert flown.moving_s == []
    assert (flown.formed, flown.state) == (False, ReceiverState.HELD)
    assert "reports with bearings of L0, L1" in flown.reason


def test_with_30_percent_lost_it_forms_and_never_outlives_its_lease(tmp_path: Path) -> None:
    flown = fly(small(tmp_path, LOST.format(drop_out=0.3, faults="")))
    lost = 1.0 - len(flown.fresh_s) / (10.0 * flown.fresh_s[-1])
    assert 0.2 < lost < 0.4
    assert (flown.formed, flown.reason[:12]) == (True, "bearings put")
    assert 0.1 < flown.latest_command_s <= flown.lease_s + LOOK_S


def test_the_papers_eight_form_with_30_percent_lost() -> None:
    playbook = changed(load_playbook(Path("sitl_configs/paper_8.yaml")), "sensor", drop_out=0.3)
    run = fly_once(playbook, playbook.plan(), seed=1)
    assert (run.outcome, run.reason) == ("formed", "")
    assert max(receiver.placement_error_m for receiver in run.receivers) < 1.0


def test_after_gaps_of_2_s_it_goes_on_by_itself(tmp_path: Path) -> None:
    flown = fly(small(tmp_path, LOST.format(drop_out=0.0, faults="gaps: {every_s: 5, for_s: 2}"), give_up_s=5.0))
    assert flown.formed
    assert flown.latest_command_s <= flown.lease_s + LOOK_S
    resumed = [then for _, then in flown.gaps() if any(then <= now_s < then + 1.0 for now_s in flown.moving_s)]
    assert len(resumed) >= 2


def test_it_gives_up_in_a_gap_that_is_longer_than_it_may_be(tmp_path: Path) -> None:
    flown = fly(small(tmp_path, LOST.format(drop_out=0.0, faults="gaps: {every_s: 5, for_s: 2}"), give_up_s=1.0))
    assert (flown.formed, flown.state) == (False, ReceiverState.HELD)
    assert "no bearing report from its sensor" in flown.reason
    assert flown.latest_command_s <= flown.lease_s + LOOK_S
    last_s = max(s for s in flown.fresh_s if s < flown.ended_s)
    assert 1.0 <= flown.ended_s - last_s < 1.7
    assert flown.moved_m > 1.0
    assert max(flown.moving_s) < flown.ended_s
