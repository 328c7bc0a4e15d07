"""What routers refuse reaches the operator and the report, whoever is restarted, and is not said over and over."""

from __future__ import annotations

import msgspec
import pytest

from drivers.bus.refusals import Refusals, encode_refusals, refusals_key
from gcs.monitor.alerts import run_alerts
from gcs.monitor.terminal import result_lines
from gcs.refused_on_bus import SAID_EVERY_S, RefusedOnBus
from gcs.status import RunStatus
from tests.fakes import FakeBus, ManualClock
from tests.gcs.monitor.test_terminal import REPORT

MAIN, SITE = refusals_key("eight", "a1"), refusals_key("eight", "b2")


class Ground:
    """The service's side, and what it said."""

    def __init__(self) -> None:
        self.clock, self.bus, self.said = ManualClock(), FakeBus(), list[str]()
        self.refused = RefusedOnBus(self.clock, self.said.append)
        self.refused.attach(self.bus, "eight")

    def hear(self, key: str, refusals: Refusals) -> None:
        self.bus.put_latest(key, encode_refusals(refusals))


def test_while_nothing_is_refused_nothing_is_said() -> None:
    ground = Ground()
    ground.hear(MAIN, Refusals())
    assert ground.said == []
    assert ground.refused.alert() is None
    assert ground.refused.report() == {
        "strangers": 0, "broken_off": 0, "without_rights": 0, "speaking": {}, "asking": {},
    }  # fmt: skip


def test_what_all_routers_refused_is_said_kept_before_the_operator_and_reported() -> None:
    ground = Ground()
    ground.hear(MAIN, Refusals(strangers=2))
    ground.hear(SITE, Refusals(strangers=1, speaking={"uav.U1": 4}))
    assert ground.said == ["2 refused on the bus: 2 strangers"]
    assert ground.refused.alert() == "7 refused on the bus: 3 strangers, 4 speaking for others (uav.U1 4)"
    assert ground.refused.report()["speaking"] == {"uav.U1": 4}
    assert msgspec.convert(ground.refused.report(), Refusals) == ground.refused.total


async def test_what_grows_is_said_again_after_a_while_and_what_does_not_is_not() -> None:
    ground = Ground()
    for count in range(1, 6):
        ground.hear(MAIN, Refusals(strangers=count))
        await ground.clock.advance(SAID_EVERY_S / 4.0)
    ground.hear(MAIN, Refusals(strangers=5))
    await ground.clock.advance(10.0 * SAID_EVERY_S)
    ground.hear(MAIN, Refusals(strangers=5))
    assert ground.said == ["1 refused on the bus: 1 stranger", "5 refused on the bus: 5 strangers"]


def test_what_a_router_refused_before_it_was_restarted_still_counts() -> None:
    ground = Ground()
    for life in range(200):
        ground.hear(refusals_key("eight", f"life{life}"), Refusals(strangers=1))
    assert ground.refused.total == Refusals(strangers=200)


@pytest.mark.parametrize("payload", [b"", b"{", b'{"strangers": "many"}', b"\xff"])
def test_what_cannot_be_read_is_counted_and_changes_nothing(payload: bytes) -> None:
    ground = Ground()
    ground.hear(MAIN, Refusals(strangers=2))
    ground.bus.put_latest(MAIN, payload)
    assert ground.refused.total == Refusals(strangers=2)
    assert ground.refused.unreadable == 1


def test_screens_and_the_result_show_what_was_refused_and_nothing_while_it_is_nothing() -> None:
    ground, status = Ground(), RunStatus("eight", ManualClock())
    status.refused_on_bus = ground.refused.alert
    assert run_alerts(status) == []
    assert result_lines(REPORT | {"refused_on_bus": ground.refused.report()}) == result_lines(REPORT)
    ground.hear(MAIN, Refusals(strangers=2))
    (alert,) = run_alerts(status)
    assert (alert.subject, alert.text) == ("bus", "2 refused on the bus: 2 strangers")
    assert "2 refused on the bus: 2 strangers" in result_lines(REPORT | {"refused_on_bus": ground.refused.report()})
