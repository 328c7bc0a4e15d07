"""Safety forbids, and says why; it never tells where to go."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from gcs.safety import PositionBoard, Safety, SafetyLimits, SitePosition
from gcs.separation import braking_way


@dataclass
class Silence:
    seconds: float = 0.0

    def silent_for_s(self) -> float:
        return self.seconds


def board(**places: complex) -> PositionBoard:
    return PositionBoard({name: SitePosition(0.0, place, 20.0) for name, place in places.items()})


def safety(
    silent_s: float = 0.0, connected: bool = True, positions: PositionBoard | None = None, separation: float = 5.0
) -> Safety:
    limits = SafetyLimits(min_separation_m=separation)
    return Safety({"U1": Silence(silent_s)}, lambda: connected, limits, positions or PositionBoard())


def test_nothing_wrong_nothing_forbidden() -> None:
    assert safety(positions=board(U1=0j, U2=20 + 0j)).objection("U1") is None


@pytest.mark.parametrize(
    ("guard", "words"),
    [
        (safety(silent_s=0.6), "no telemetry for 0.6 s"),
        (safety(connected=False), "the bus router cannot be reached"),
        (safety(positions=board(U1=0j, U2=3.9 + 0j, U3=50j)), "only 3.9 m from U2"),
    ],
)
def test_each_danger_has_its_own_words(guard: Safety, words: str) -> None:
    objection = guard.objection("U1")
    assert objection is not None
    assert words in objection


def test_the_planned_separation_itself_is_allowed() -> None:
    assert safety(positions=board(U1=0j, U2=5 + 0j)).objection("U1") is None


def test_without_positions_it_still_watches_link_and_bus() -> None:
    assert safety().objection("U1") is None
    assert safety(silent_s=1.0).objection("U1") is not None


def test_a_vehicle_without_a_position_has_no_neighbours() -> None:
    assert board(U2=1j).smallest_separation_m("U1") is None
    assert board(U1=1j).smallest_separation_m("U1") is None
    assert board(U1=0j, U2=3 + 4j).smallest_separation_m("U1") == (5.0, "U2")


def test_a_transmitter_away_from_its_place_is_not_standing() -> None:
    vehicles, told = {"L0": Silence(), "L1": Silence()}, board(L0=3.0 + 2.0j, L1=103.0 + 0j)
    watched = Safety(vehicles, lambda: True, SafetyLimits(), told, {"L0": 0j, "L1": 100 + 0j})
    assert watched.objection("L0") == "it is 3.6 m from its place: have its pilot bring it back"
    assert watched.objection("L1") is None


def flying(place: complex, velocity: complex, time_s: float = 0.0) -> SitePosition:
    return SitePosition(time_s, place, 20.0, braking_way(velocity))


def test_who_would_brake_into_another_is_told_to_while_it_can() -> None:
    near = safety(positions=PositionBoard({"U1": flying(0j, 4 + 0j), "U2": flying(11 + 0j, 0j)}))
    assert near.objection("U1") == "only 11.0 m from U2, and braking from now it would be 3.8 m"
    for other in (flying(11 + 0j, 4 + 0j), flying(11.3 + 0j, 0j), flying(11 + 5j, 0j), flying(-5 + 0j, 0j)):
        assert safety(positions=PositionBoard({"U1": flying(0j, 4 + 0j), "U2": other})).objection("U1") is None


def test_who_was_stopped_does_not_fly_on_there() -> None:
    told = PositionBoard({"U1": flying(0j, 4 + 0j), "U2": flying(11 + 0j, 0j)})
    guard = Safety({"U1": Silence(), "U2": Silence()}, lambda: True, SafetyLimits(), told)
    assert guard.objection("U1") is not None
    told.latest["U1"] = flying(6.5 + 0j, 0j, 3.0)
    assert guard.objection("U1") == "it is kept from U2, 4.5 m away"
    assert guard.objection("U2") is None, "who stands is no danger to anybody"
    told.latest["U2"] = flying(15 + 0j, 0j)
    assert guard.objection("U1") is None
