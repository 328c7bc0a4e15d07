"""The stages of a run, one after another: whatever becomes of one, nobody flies on by it, and it is all told."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from drivers.bus.messages import Emission, decode
from drivers.errors import SimulationError, VehicleError
from drivers.mavlink.setpoints import StreamState
from gcs.control import STOPPED
from gcs.playbook.stages import Inject, StageEntry
from gcs.stages.registry import STAGES
from gcs.stages.simulation import End
from tests.gcs.stages.bench import PILOTED, Bench

UP = "preflight\ntakeoff\n"


async def test_stages_are_done_one_after_another_and_told_with_their_times(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "wait: {for_s: 3}\nhold: {for_s: 4, name: stand}\nland")
    await bench.fly()
    told = [(each.name, each.kind, each.outcome, each.began_s, each.ended_s) for each in bench.run.results]
    assert [each[:3] for each in told] == [
        ("wait", "wait", "done"),
        ("stand", "hold", "done"),
        ("land", "land", "done"),
    ]
    assert [ended_s - began_s for *_, began_s, ended_s in told] == pytest.approx([3.0, 4.0, 2.0])
    assert bench.run.outcome == "completed"
    assert [line["state"] for line in bench.journal if line.get("stage") == "stand"] == ["begun", "done"]
    report = bench.run.report()
    assert report["stages"][1] == {
        "name": "stand", "kind": "hold", "outcome": "done", "began_s": pytest.approx(3.0),
        "ended_s": pytest.approx(7.0), "reason": "",
    }  # fmt: skip


async def test_a_stage_that_takes_too_long_holds_everybody_first(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "wait: {for_s: 60, timeout_s: 5, on_failure: land}\nhold: {for_s: 1}")
    stream = bench.run.members["U1"].stream
    stream.renew(1.0 + 0j)
    await bench.fly(meanwhile=lambda now_s: None if now_s > 4.9 else stream.renew(1 + 0j))
    assert bench.outcomes() == {"wait": "failed", "wait-land": "done", "hold": "not_reached"}
    assert stream.state is StreamState.STOPPING
    assert bench.run.results[0].reason == "wait took longer than 5 s"
    assert bench.run.results[0].ended_s == pytest.approx(5.0, abs=0.2)
    assert sorted(bench.autopilot.told) == ["land L0", "land L1", "land U1", "land U2"]
    assert bench.run.outcome == "failed"


@pytest.mark.parametrize(
    ("on_failure", "after", "told"),
    [
        ("hold", "not_reached", 0),
        ("abort", "not_reached", 0),
        ("skip", "done", 0),
        ("land", "not_reached", 4),
        ("return", "not_reached", 4),
    ],
)
async def test_what_is_done_on_failure(tmp_path: Path, on_failure: str, after: str, told: int) -> None:
    bench = Bench(tmp_path, UP + f"prompt: {{text: ready?, on_failure: {on_failure}}}\nwait: {{for_s: 1}}")
    await bench.fly()
    assert bench.outcomes()["prompt"] == "failed"
    assert bench.outcomes()["wait"] == after
    assert len(bench.autopilot.told) == told
    assert "--attended" in bench.run.results[0].reason


async def test_attended_a_failure_waits_for_the_operator(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "wait: {for_s: 9, timeout_s: 1}\nwait: {for_s: 1}", attended=True)

    def resume(now_s: float) -> None:
        if now_s == pytest.approx(20.0):
            assert bench.speak("resume").ok

    await bench.fly(meanwhile=resume)
    assert bench.outcomes() == {"wait": "failed", "wait-2": "done"}
    assert bench.run.results[1].began_s == pytest.approx(20.0, abs=0.3)
    assert "bearing-relay control resume, or abort" in bench.said()


async def test_a_prompt_goes_on_by_resume_and_only_by_it(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "prompt: {text: 'Is the field clear?'}\nwait: {for_s: 1}", attended=True)

    def answer(now_s: float) -> None:
        if now_s == pytest.approx(3.0):
            assert "resume goes on" in bench.speak("hold").message
            assert not bench.speak("skip", "U1").ok
            assert bench.run.results == []
            assert bench.speak("resume").ok

    await bench.fly(meanwhile=answer)
    assert bench.outcomes() == {"prompt": "done", "wait": "done"}
    assert "Is the field clear?" in bench.said()


async def test_the_terminal_may_answer_too_and_no_means_stop(tmp_path: Path) -> None:
    for word, outcome in ((True, "done"), (False, "stopped")):
        bench = Bench(tmp_path, UP + "prompt: {text: ready?}", attended=True)

        async def typed(clock=bench.clock, word: bool = word) -> bool:
            await clock.sleep(1.0)
            return word

        bench.run.operator.terminal = typed
        await bench.fly()
        assert bench.outcomes() == {"prompt": outcome}


@pytest.mark.parametrize("stop", [lambda bench: bench.speak("abort"), lambda bench: bench.run.operator.stop(STOPPED)])
async def test_the_operator_stops_a_run_in_any_stage_and_nothing_is_done_on_failure(tmp_path: Path, stop) -> None:
    bench = Bench(tmp_path, UP + "hold: {for_s: 60, on_failure: land}\nland")
    stream = bench.run.members["U2"].stream

    def meanwhile(now_s: float) -> None:
        if now_s == pytest.approx(2.0):
            stream.renew(1 + 0j)
            stop(bench)

    await bench.fly(meanwhile=meanwhile)
    assert bench.outcomes() == {"hold": "stopped", "land": "not_reached"}
    assert bench.run.results[0].reason == STOPPED
    assert bench.autopilot.told == []
    assert stream.state is StreamState.STOPPING
    assert bench.run.outcome == "aborted"


async def test_what_only_looks_is_tried_again(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "connect: {retries: 2}\nconnect: {retries: 1, name: never, on_failure: skip}", flying=False)
    tries: dict[str, int] = {"connect": 0, "never": 0}

    async def heard(timeout_s: float, awaited: str) -> None:
        tries[bench.run.stage] += 1
        if bench.run.stage == "never" or tries["connect"] < 3:
            raise VehicleError("U1", "bench", f"no {awaited} within {timeout_s} s", "Look.")

    for vehicle in bench.vehicles.values():
        vehicle.wait_until = lambda _, timeout_s, awaited, __: heard(timeout_s, awaited)
        vehicle.system_id = 1
    bench.vehicles = bench.run.fleet.vehicles = {"U1": bench.vehicles["U1"]}
    await bench.fly_stages(bench.playbook.flow)
    assert bench.outcomes() == {"connect": "done", "never": "failed"}
    assert tries == {"connect": 3, "never": 2}
    assert "no heartbeat of system id 1" in bench.run.results[1].reason


async def test_a_mistake_in_the_program_is_no_failed_stage_and_everybody_is_stopped(
    tmp_path: Path, monkeypatch
) -> None:
    bench = Bench(tmp_path, UP + "land")
    stream = bench.run.members["U1"].stream
    stream.renew(1 + 0j)
    monkeypatch.setattr(bench.autopilot, "land", lambda vehicle: asyncio.sleep(0, 1 / 0))
    with pytest.raises(ExceptionGroup) as raised:
        await bench.fly()
    assert raised.group_contains(ZeroDivisionError)
    assert stream.state is StreamState.STOPPING
    assert bench.outcomes() == {"land": "stopped"}


async def test_landing_leaves_a_pilots_vehicle_alone_and_one_that_fails_keeps_no_other(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "land")
    bench.run.members["U1"].stream.state = StreamState.PILOT
    bench.autopilot.refuses = {"land L1"}
    await bench.fly()
    assert sorted(bench.autopilot.told) == ["land L0", "land L1", "land U2"]
    assert bench.outcomes() == {"land": "failed"}
    assert not bench.vehicles["U2"].armed
    assert bench.vehicles["U1"].armed


async def test_vehicles_return_one_after_another_past_nobody(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "return")
    frame, board = bench.playbook.site.frame, bench.run.board
    for name, place in {"U1": 70 + 60j, "U2": 65 + 45j}.items():  # U2 hovers in U1's way
        board.latest[name] = type(board.latest[name])(0.0, frame.to_site(place), 20.0)
    await bench.fly()
    assert bench.outcomes() == {"return": "done"}
    order = [told.removeprefix("return ") for told in bench.autopilot.told]
    assert set(order[:2]) == {"L0", "L1"}
    assert order[2:] == ["U2", "U1"]
    assert bench.run.results[0].ended_s == pytest.approx(8.0, abs=0.5)


async def test_a_return_that_leads_past_somebody_is_not_begun(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "return: {on_failure: land}")
    frame, board = bench.playbook.site.frame, bench.run.board
    starts = bench.playbook.uavs
    for name, place in {"U1": starts["U2"], "U2": starts["U1"]}.items():  # each hovers above the other's home
        board.latest[name] = type(board.latest[name])(0.0, frame.to_site(place), 20.0)
    await bench.fly()
    assert bench.outcomes() == {"return": "failed", "return-land": "done"}
    assert "hover in each other's way home" in bench.run.results[0].reason
    assert sorted(bench.autopilot.told) == ["land U1", "land U2", "return L0", "return L1"]


async def test_a_return_whose_time_is_over_stops_on_its_way_and_lands(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "return: {timeout_s: 3, on_failure: land}")
    await bench.fly()
    assert bench.outcomes() == {"return": "failed", "return-land": "done"}
    first, second, held, *landed = bench.autopilot.told
    assert held == second.replace("return", "hold")
    assert {told.removeprefix("land ") for told in landed} == {"L0", "L1", "U1", "U2"} - {first.removeprefix("return ")}


async def test_one_whose_pilot_takes_it_on_its_way_home_is_his(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "return: {timeout_s: 1, on_failure: land}")
    taken: list[str] = []

    def take(now_s: float) -> None:
        if bench.autopilot.told and not taken:
            taken.append(bench.autopilot.told[0].removeprefix("return "))
            bench.vehicles[taken[0]].enter(PILOTED)

    await bench.fly(meanwhile=take)
    assert f"hold {taken[0]}" not in bench.autopilot.told
    assert f"land {taken[0]}" not in bench.autopilot.told
    assert bench.outcomes() == {"return": "failed", "return-land": "failed"}


async def test_a_relay_without_bearings_holds_and_what_is_done_on_failure_is_done(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "relay: {on_failure: land, expect: {outcome: aborted, receivers_held: 1}}")
    await bench.fly()
    assert bench.outcomes() == {"relay": "failed", "relay-land": "done"}
    assert bench.run.outcome == "aborted"
    assert "is held: only 0 of 10 reports" in bench.run.results[0].reason
    assert [verdict.passed for verdict in bench.run.verdicts] == [True, True]
    assert sum(told.startswith("land") for told in bench.autopilot.told) == 4


async def test_a_relay_whose_time_is_over_ends_in_its_own_order(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "relay: {timeout_s: 1, on_failure: skip}\nhold: {for_s: 1}")
    await bench.fly()
    assert bench.outcomes() == {"relay": "failed", "hold": "done"}
    assert bench.run.results[0].reason == "relay took longer than 1 s"
    states = {record.state.value for record in bench.run.records.values()}
    assert states == {"HELD", "WAITING"}
    assert bench.run.relay is not None
    assert bench.run.relay.ended
    assert bench.run.emission.on_air == frozenset()


async def test_in_the_relay_the_operators_words_are_the_relays_and_abort_ends_the_run(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "wait: {for_s: 2}\nrelay\nland")
    answers: list[str] = []

    def speak(now_s: float) -> None:
        for at_s, verb in ((1.0, "hold"), (3.0, "hold"), (60.0, "abort")):
            if now_s == pytest.approx(at_s):
                answers.append(bench.speak(verb).message)

    await bench.fly(meanwhile=speak)
    assert answers[0].startswith("no relay is being flown")
    assert answers[1].startswith("the relay is held; stopped: U")
    assert answers[2].startswith("the relay ends")
    assert bench.outcomes() == {"wait": "done", "relay": "stopped", "land": "not_reached"}
    assert bench.autopilot.told == []


async def test_a_take_off_that_fails_stops_those_on_their_way_up(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "preflight\ntakeoff: {on_failure: land}", flying=False)
    bench.run.autopilots = dict.fromkeys(bench.vehicles, bench.autopilot)  # type: ignore[arg-type]
    bench.autopilot.refuses = {"take_off L0"}
    await bench.fly_stages(bench.playbook.flow[1:])
    assert bench.outcomes() == {"takeoff": "failed", "takeoff-land": "done"}
    held = {told for told in bench.autopilot.told if told.startswith("hold")}
    assert held == {"hold L0", "hold L1", "hold U1", "hold U2"}
    assert all(not vehicle.armed for vehicle in bench.vehicles.values())


async def test_one_stopped_on_its_way_up_and_then_taken_by_its_pilot_is_left_alone(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "preflight\ntakeoff: {on_failure: land, timeout_s: 1}", flying=False)
    bench.run.autopilots = dict.fromkeys(bench.vehicles, bench.autopilot)  # type: ignore[arg-type]
    hold = bench.autopilot.hold

    def hold_and_lose(vehicle) -> None:
        hold(vehicle)
        if vehicle.name == "U1":
            vehicle.enter(PILOTED)

    bench.autopilot.hold = hold_and_lose  # type: ignore[method-assign]
    await bench.fly_stages(bench.playbook.flow[1:])
    assert bench.outcomes() == {"takeoff": "failed", "takeoff-land": "failed"}
    assert "land U1" not in bench.autopilot.told
    assert "land U2" in bench.autopilot.told


async def test_nothing_is_armed_without_a_preflight_and_nothing_flown_without_a_take_off(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "preflight\ntakeoff: {on_failure: skip}\nrelay", flying=False)
    await bench.fly_stages(bench.playbook.flow[1:])
    assert bench.outcomes() == {"takeoff": "failed", "relay": "failed"}
    assert "was not cleared by a preflight" in bench.run.results[0].reason
    assert "is not in guided flight" in bench.run.results[1].reason
    assert bench.autopilot.told == []


async def test_arming_is_done_once_for_each_and_ends_with_the_first_that_refuses(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "preflight\narm", flying=False)
    bench.run.autopilots = dict.fromkeys(bench.vehicles, bench.autopilot)  # type: ignore[arg-type]
    bench.vehicles["L0"].armed = True
    bench.autopilot.refuses = {"arm U1"}
    await bench.fly_stages(bench.playbook.flow[1:])
    assert bench.autopilot.told == ["arm L1", "arm U1"]
    assert bench.outcomes() == {"arm": "failed"}
    assert "arm refused" in bench.run.results[0].reason


async def test_transmitters_are_kept_on_until_they_are_let_go(tmp_path: Path) -> None:
    stages = "emission: {on: [L0, U1]}\nwait: {for_s: 5}\nemission: {off: [U1]}\nwait: {for_s: 2}"
    bench = Bench(tmp_path, stages)
    await bench.fly()
    switched = [(key.split("/")[-2], decode(payload, Emission).on) for key, payload in bench.bus.sent]
    assert switched == [("L0", True), ("U1", True), ("U1", False), ("L0", False)]
    assert bench.run.report()["emission_transmitter_s"] == pytest.approx(12.0)


async def test_what_is_measured_is_in_the_report(tmp_path: Path) -> None:
    bench = Bench(tmp_path, UP + "measure: {for_s: 4, every_s: 0.5, name: at-the-slots}")
    record, frame = bench.run.records["U1"], bench.playbook.site.frame
    board = bench.run.board

    def sway(now_s: float) -> None:
        off_m = 1.0 if now_s < 2.0 else 3.0
        board.latest["U1"] = type(board.latest["U1"])(0.0, frame.to_site(record.route.target + off_m), 20.0)
        bench.run.score.moved("U1")

    await bench.fly(meanwhile=sway)
    (measured,) = bench.run.report()["measurements"]
    assert measured["stage"] == "at-the-slots"
    assert measured["samples"] == 8
    assert measured["duration_s"] == pytest.approx(4.0)
    assert measured["receivers"]["U1"]["max_m"] == pytest.approx(3.0)
    assert 1.0 < measured["receivers"]["U1"]["mean_m"] < 3.0
    assert measured["min_separation_m"] > 5.0
    assert "U2" not in measured["receivers"]  # it has told no place


async def test_a_fault_strikes_at_its_moment_and_ends(tmp_path: Path) -> None:
    stages = "inject: {fault: freeze, vehicle: L1, after_s: 2, for_s: 3}\nwait: {for_s: 9}"
    bench = Bench(tmp_path, stages)
    await bench.fly()
    assert bench.struck == ["freeze L1 at 2.0", "over at 5.0"]
    assert bench.outcomes() == {"inject": "done", "wait": "done"}


@pytest.mark.parametrize(
    ("fault", "over"), [("disk_full, for_s: 30", True), ("disk_full", True), ("freeze, vehicle: L1, for_s: 30", False)]
)
async def test_what_befalls_the_service_itself_ends_with_the_stages_and_nothing_else_does(
    tmp_path: Path, fault: str, over: bool
) -> None:
    bench = Bench(tmp_path, f"inject: {{fault: {fault}}}\nwait: {{for_s: 9}}")
    await bench.fly()
    assert ("over at 9.0" in bench.struck) is over


async def test_a_fault_that_cannot_be_ended_is_said_and_ends_nothing(tmp_path: Path) -> None:
    bench = Bench(tmp_path, "inject: {fault: router_killed, for_s: 2}\nwait: {for_s: 9}")

    async def end() -> None:
        raise SimulationError("no port is free")

    async def strike(_stage: Inject) -> End:
        return end

    bench.run.simulation.strike = strike
    await bench.fly()
    assert "not over: router_killed: no port is free" in bench.said()
    assert bench.outcomes() == {"inject": "done", "wait": "done"}


async def test_verdicts_are_given_after_each_stage_and_at_the_end(tmp_path: Path) -> None:
    stages = (
        UP
        + "wait: {for_s: 2, expect: {stage_duration_s.wait: '1.5 .. 2.5'}}\n"
        + "wait: {for_s: 9, timeout_s: 1, expect: {receivers_placed: 2}}\n"
        + "hold: {for_s: 1, name: never, expect: {duration_s: '< 100'}}"
    )
    bench = Bench(tmp_path, stages, "expect: {outcome: failed}\n")
    await bench.fly()
    told = [(verdict.stage, verdict.figure, verdict.passed) for verdict in bench.run.verdicts]
    assert told == [
        ("wait", "stage_duration_s.wait", True),
        ("wait-2", "receivers_placed", False),
        ("never", "duration_s", False),
        ("", "outcome", True),
    ]


def test_every_word_of_a_playbook_has_its_stage() -> None:
    assert {field.alias or name for name, field in StageEntry.model_fields.items()} == STAGES.keys()
