"""What reaches a link at a node: nothing that the tenure does not let through at that moment."""

from __future__ import annotations

from typing import Any

from drivers.mavlink.link import Setpoint
from gcs.nodes.messages import Grant, VehicleGrant
from gcs.nodes.tenure import YIELD_S, Tenure
from gcs.nodes.wires import GatedChannel
from tests.fakes import ManualClock

GRANT_S = 1.0


class FakeLink:
    def __init__(self) -> None:
        self.posted: list[Any] = []

    def post(self, message: Any) -> None:
        self.posted.append(message)

    def post_urgent(self, message: Any) -> None:
        self.posted.append(message)

    def post_setpoint(self, _system_id: int, setpoint: Setpoint) -> None:
        self.posted.append(setpoint)


def gated() -> tuple[GatedChannel, FakeLink, ManualClock]:
    """A channel whose vehicle is granted from now on for as long as a grant lasts."""
    clock, tenure, link = ManualClock(), Tenure(life=1), FakeLink()
    tenure.assign("U1", 1, GRANT_S)
    tenure.take(Grant(1, round(clock.now_s() * 1e9), 1, {"U1": VehicleGrant(1)}), clock.now_s())
    channel: Any = GatedChannel("U1", link, tenure, clock)  # type: ignore[arg-type]
    return channel, link, clock


def all_kinds(channel: GatedChannel, now_s: float) -> None:
    channel.post("command")
    channel.post_urgent("stop")
    channel.post_setpoint(1, Setpoint("fly", now_s + 9.0, stops=False))
    channel.post_setpoint(1, Setpoint("zero", now_s + 9.0, stops=True))


def kinds(link: FakeLink) -> list[Any]:
    return [posted.message if isinstance(posted, Setpoint) else posted for posted in link.posted]


async def test_a_granted_vehicle_is_sent_everything_but_no_motion_outlasts_the_grant() -> None:
    channel, link, clock = gated()
    all_kinds(channel, clock.now_s())
    assert kinds(link) == ["command", "stop", "fly", "zero"]
    assert link.posted[2].expires_s == 100.0 + GRANT_S
    assert link.posted[3].expires_s == 100.0 + GRANT_S + YIELD_S


async def test_when_the_grant_has_run_out_only_stops_leave_and_then_nothing() -> None:
    channel, link, clock = gated()
    await clock.advance(GRANT_S)
    all_kinds(channel, clock.now_s())
    assert kinds(link) == ["stop", "zero"]
    link.posted.clear()
    await clock.advance(YIELD_S)
    all_kinds(channel, clock.now_s())
    assert link.posted == []
