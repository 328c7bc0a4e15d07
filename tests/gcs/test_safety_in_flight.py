"""What forbids a vehicle to fly on that was fit at first: its battery, the fence, a neighbour long not heard."""

from __future__ import annotations

import pytest

from gcs.safety import PositionBoard, Safety, SafetyLimits, SitePosition

FENCE = (0j, 100 + 0j, 100 + 100j, 100j)


class Heard:
    def silent_for_s(self) -> float:
        return 0.0


def guard(place: complex = 50 + 50j, percent: int | None = None, **others: SitePosition) -> Safety:
    board = PositionBoard({"U1": SitePosition(100.0, place, 20.0), **others})
    vehicles = dict.fromkeys(board.latest, Heard())
    return Safety(vehicles, lambda: True, SafetyLimits(), board, {}, lambda _: percent, FENCE)


@pytest.mark.parametrize(("percent", "words"), [(None, None), (100, None), (16, None), (15, "15 %"), (0, "0 %")])
def test_a_battery_that_is_nearly_empty_forbids(percent: int | None, words: str | None) -> None:
    objection = guard(percent=percent).objection("U1")
    assert objection is None if words is None else objection == f"its battery is down to {words}: land it"


def test_who_does_not_tell_of_a_battery_or_has_no_fence_is_not_forbidden() -> None:
    plain = Safety({"U1": Heard()}, lambda: True, SafetyLimits(), PositionBoard())
    assert plain.objection("U1") is None


@pytest.mark.parametrize(
    ("place", "over"), [(1 + 1j, None), (-2 + 50j, None), (-4 + 50j, "4.0 m"), (50 + 140j, "40.0 m")]
)
def test_the_fence_is_watched_in_flight(place: complex, over: str | None) -> None:
    objection = guard(place).objection("U1")
    assert (
        objection is None
        if over is None
        else objection == (f"it is {over} outside the fence: have its pilot bring it back")
    )


def test_a_neighbour_that_fell_silent_counts_where_it_was_last_heard() -> None:
    long_ago = SitePosition(10.0, 52 + 50j, 20.0)
    assert guard(U2=long_ago).objection("U1") == "only 2.0 m from U2"
