"""Fencing: two nodes never both may command one vehicle, whatever the network and the clocks do."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gcs.errors import ServiceError
from gcs.nodes.messages import Beat, Grant, VehicleGrant
from gcs.nodes.ownership import NodeView, Ownership, TooEarlyError
from gcs.nodes.tenure import YIELD_S, Authority, Tenure
from gcs.nodes.tokens import Tokens
from tests.gcs.nodes.feud import GRANT_S, Feud, Hardship

SECOND_NS = 1_000_000_000


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    seed=st.integers(0, 2**32),
    loss=st.floats(0.0, 0.6),
    longest_delay_s=st.floats(0.01, 8.0),
    drift=st.floats(0.0, 0.005),
)
def test_two_nodes_never_both_may_command_one_vehicle(
    tmp_path_factory: pytest.TempPathFactory, seed: int, loss: float, longest_delay_s: float, drift: float
) -> None:
    hardship = Hardship(seed, loss, longest_delay_s, drift)
    feud = Feud(tmp_path_factory.mktemp("feud"), hardship).run(60.0)
    assert not feud.contested
    assert not feud.obeyed_old


def test_vehicles_are_commanded_and_given_on_in_such_a_world(tmp_path: Path) -> None:
    """What never happens because nothing happens is no proof."""
    feud = Feud(tmp_path, Hardship(7)).run(200.0)
    assert feud.given_on >= 5
    assert feud.granted_s > 100.0


class GrantedFromReceipt(Tenure):
    """Wrong: counts a grant from when it came."""

    def take(self, grant: Grant, now_s: float) -> list[str]:
        return super().take(Grant(grant.life, round(now_s * 1e9), grant.number, grant.vehicles), now_s)


class Tokenless(Tenure):
    """Wrong: takes everybody's word."""

    def obeys(self, vehicle: str, token: int, now_s: float) -> str | None:
        return None if self.authority(vehicle, now_s) is Authority.GRANTED else "not granted"


class Lingering(Tenure):
    """Wrong: goes on for as long as it likes."""

    def take(self, grant: Grant, now_s: float) -> list[str]:
        stopped = super().take(grant, now_s)
        for held in self.holdings.values():
            held.until_s += 2.0
        return stopped


class Hasty(Ownership):
    """Wrong: does not wait until a grant has run out."""

    def free_at_s(self, node: str) -> float:
        return self.nodes[node].answered_s + self.grant_s


class Unguarded(Ownership):
    """Wrong: forgets that what it sends at once is an answer, too."""

    def grant(self, node: str) -> Grant | None:
        before_s = self.nodes[node].answered_s
        grant = super().grant(node)
        self.nodes[node].answered_s = min(before_s, self.nodes[node].answered_s)
        return grant


@pytest.mark.parametrize("wrong", [GrantedFromReceipt, Lingering])
def test_a_node_that_counts_its_grants_wrongly_is_found(tmp_path: Path, wrong: type[Tenure]) -> None:
    assert any(Feud(tmp_path, Hardship(seed), make_tenure=wrong).run(60.0).contested for seed in range(20))


@pytest.mark.parametrize("wrong", [Hasty, Unguarded])
def test_a_service_that_gives_on_too_early_is_found(tmp_path: Path, wrong: type[Ownership]) -> None:
    assert any(Feud(tmp_path, Hardship(seed), make_ownership=wrong).run(60.0).contested for seed in range(20))


def test_a_node_that_does_not_look_at_tokens_is_found(tmp_path: Path) -> None:
    assert any(Feud(tmp_path, Hardship(seed), make_tenure=Tokenless).run(60.0).obeyed_old for seed in range(40))


def granted(tenure: Tenure, token: int, made_s: float, now_s: float, number: int = 1, stops: int = 0) -> list[str]:
    grant = Grant(tenure.life, round(made_s * SECOND_NS), number, {"U1": VehicleGrant(token, stops)})
    return tenure.take(grant, now_s)


def test_a_grant_lasts_from_the_beat_that_it_answers_and_then_comes_a_stop_and_silence() -> None:
    tenure = Tenure(life=1)
    assert tenure.assign("U1", 5, GRANT_S)
    assert tenure.authority("U1", 10.0) is Authority.NONE
    granted(tenure, 5, made_s=10.0, now_s=10.7)
    assert tenure.authority("U1", 10.99) is Authority.GRANTED
    assert tenure.authority("U1", 11.0) is Authority.STOPPING
    assert tenure.authority("U1", 11.0 + YIELD_S - 0.01) is Authority.STOPPING
    assert tenure.authority("U1", 11.0 + YIELD_S) is Authority.NONE


def test_old_tokens_and_grants_of_another_life_are_refused_and_counted() -> None:
    tenure = Tenure(life=1)
    tenure.assign("U1", 5, GRANT_S)
    granted(tenure, 5, 10.0, 10.0)
    assert tenure.obeys("U1", 5, 10.1) is None
    assert "older than the highest" in (tenure.obeys("U1", 4, 10.1) or "")
    assert not tenure.assign("U1", 4, GRANT_S)
    granted(tenure, 4, 10.5, 10.5, number=2)
    tenure.take(Grant(2, round(10.5 * SECOND_NS), 3, {"U1": VehicleGrant(5)}), 10.5)
    assert tenure.authority("U1", 11.1) is Authority.STOPPING
    assert tenure.refused == {"old token": 3, "grant for another life": 1}


def test_a_grant_for_a_beat_that_was_not_made_yet_is_none() -> None:
    tenure = Tenure(life=1)
    tenure.assign("U1", 5, GRANT_S)
    granted(tenure, 5, made_s=99.0, now_s=10.0)
    assert tenure.authority("U1", 10.0) is Authority.NONE


def test_a_word_to_stop_is_heard_once_and_an_overtaken_grant_takes_nothing_back() -> None:
    tenure = Tenure(life=1)
    tenure.assign("U1", 5, GRANT_S)
    assert granted(tenure, 5, 10.0, 10.0, number=3, stops=2) == ["U1"]
    assert granted(tenure, 5, 10.0, 10.1, number=4, stops=2) == []
    granted(tenure, 5, 10.0, 10.2, number=1, stops=1)
    assert tenure.holdings["U1"].granted.stops == 2


def ownership(folder: Path) -> Ownership:
    owned = Ownership(Tokens(folder / "tokens.jsonl", floor=0), GRANT_S, {"north": NodeView(), "south": NodeView()})
    owned.begin({"U1": "north", "U2": "south"})
    owned.find("north")
    return owned


def test_a_vehicle_is_given_on_only_when_its_node_is_lost_and_its_last_grant_has_run_out(tmp_path: Path) -> None:
    owned = ownership(tmp_path)
    first = owned.held["U1"].token
    assert owned.answer("north", Beat(1, 1), now_s=50.0) is not None
    with pytest.raises(TooEarlyError):
        owned.give_on(["U1"], "south", now_s=1e6)  # it is not lost
    owned.lose("north", "no beat")
    assert owned.answer("north", Beat(1, 2), now_s=51.0) is None
    free_at_s = owned.free_at_s("north")
    assert free_at_s > 50.0 + GRANT_S + YIELD_S
    with pytest.raises(TooEarlyError):
        owned.give_on(["U1"], "south", now_s=free_at_s - 0.01)
    owned.give_on(["U1"], "south", now_s=free_at_s)
    assert owned.of("south") == ["U1", "U2"]
    assert owned.held["U1"].token > first


def test_tokens_never_fall_over_services_and_runs(tmp_path: Path) -> None:
    path = tmp_path / "tokens.jsonl"
    first = Tokens(path, floor=1000).give(["U1"], "north")["U1"]
    assert first > 1000
    path.write_bytes(path.read_bytes() + b'{"vehicle":"U1","node":"so')  # killed as it wrote
    again = Tokens(path, floor=0)
    assert again.last["U1"].node == "north"
    assert again.give(["U1"], "south")["U1"] > first
    assert Tokens(path, floor=0).last["U1"].node == "south"
    assert Tokens(tmp_path / "next_run.jsonl", floor=2000).give(["U1"], "north")["U1"] > first


def test_a_token_that_cannot_be_kept_is_not_given(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="cannot be written"):
        Tokens(tmp_path / "gone" / "tokens.jsonl", floor=0).give(["U1"], "north")
