"""The stages of a playbook: what may be written, and what is refused, each problem at its place."""

from __future__ import annotations

import json
from pathlib import Path
from typing import get_args

import jsonschema
import pytest
from ruamel.yaml import YAML

from gcs.playbook.json_schema import playbook_schema
from gcs.playbook.loader import PlaybookError, load_playbook
from gcs.playbook.schema import Playbook
from gcs.playbook.stages import BareWord, RelayState, StageEntry
from gcs.relay.states import ReceiverState

HEAD = """\
playbook: 1
name: staged
formation: {kind: circle, slots: 3, radius_m: 60}
transmitters: {L0: {at: [0, 0]}, L1: {at: [60, 0], beacon: true}}
receivers: {U1: {start: [30, 50]}, U2: {start: [-70, 20]}, U3: {start: [15, -80]}}
stages:
"""
FIRST_LINE = HEAD.count("\n") + 1
CHECK = jsonschema.Draft202012Validator(playbook_schema())
EVERY_STAGE = """\
  - connect: {retries: 2, timeout_s: 90}
  - preflight
  - prompt: {text: "Is the field clear?"}
  - arm
  - takeoff: {name: up, on_failure: land}
  - locate: {retries: 1}
  - plan:
  - emission: {on: [L0, U1]}
  - inject: {fault: link_cut, vehicle: U2, at: {receiver: U1, state: LEG_2, after_s: 1.5}, for_s: 3}
  - inject: {fault: link_faults, vehicle: U1, loss: 0.3, duplication: 0.1, reordering: 0.1, delay_s: 0.2, jitter_s: 0.1}
  - inject: {fault: router_killed, after_s: 60, for_s: 5}
  - inject: {fault: sensor_jump, vehicle: U1, jump_deg: -90, of: L1, after_s: 5, for_s: 2}
  - inject: {fault: transmitter_silent, vehicle: L1}
  - inject: {fault: transmitter_drift, vehicle: L0, speed_mps: 0.5, course_deg: 270}
  - relay: {timeout_s: 300, on_failure: return, expect: {placement_error_m: "< 1", placement_error_m.U3: "< 2"}}
  - hold: {for_s: 10}
  - emission: {off: [U1]}
  - measure: {for_s: 5, every_s: 0.5, expect: {stage_duration_s.measure: "< 10"}}
  - wait: {for_s: 1}
  - return
  - wait: {for_s: 2}
"""


def load(tmp_path: Path, text: str) -> Playbook:
    path = tmp_path / "staged.yaml"
    path.write_text(text, encoding="utf-8")
    return load_playbook(path)


def problems(tmp_path: Path, text: str) -> list[str]:
    with pytest.raises(PlaybookError) as caught:
        load(tmp_path, text)
    return [f"{problem.line}:{problem.column}: {problem.message}" for problem in caught.value.problems]


def test_every_stage_can_be_written_and_is_read_back_from_what_a_run_leaves(tmp_path: Path) -> None:
    playbook = load(tmp_path, HEAD + EVERY_STAGE)
    assert {stage.kind for stage in playbook.flow} | {"land"} == {
        field.alias or name for name, field in StageEntry.model_fields.items()
    }
    names = [stage.name for stage in playbook.flow]
    assert names[4] == "up"
    assert names[-1] == "wait-2"
    assert [name for name in names if name.startswith("inject")] == [
        "inject", *(f"inject-{number}" for number in range(2, 7)),
    ]  # fmt: skip
    resolved = json.loads(json.dumps(playbook.model_dump(mode="json")))
    assert Playbook.model_validate(resolved) == playbook
    CHECK.validate(resolved)
    CHECK.validate(YAML(typ="safe", pure=True).load(HEAD + EVERY_STAGE))


def test_without_stages_a_playbook_is_flown_as_ever(tmp_path: Path) -> None:
    plain = HEAD.removesuffix("stages:\n")
    assert [stage.name for stage in load(tmp_path, plain).flow] == ["preflight", "takeoff", "relay"]
    landing = load(tmp_path, plain + "flight: {land_after: true}\n")
    assert [stage.name for stage in landing.flow] == ["preflight", "takeoff", "relay", "land"]
    assert {stage.settings.on_failure for stage in landing.flow} == {"abort"}


def test_what_needs_no_settings_is_one_word(tmp_path: Path) -> None:
    for word in get_args(BareWord):
        assert StageEntry.model_validate(word).kind == word
    for word in {field.alias or name for name, field in StageEntry.model_fields.items()} - set(get_args(BareWord)):
        text = HEAD + f"  - preflight\n  - takeoff\n  - {word}\n"
        assert problems(tmp_path, text)
        assert not CHECK.is_valid(YAML(typ="safe", pure=True).load(text))


def test_the_moments_of_the_relay_are_its_states() -> None:
    assert set(get_args(RelayState)) == {state.value for state in ReceiverState} - {"WAITING"}


UP = "  - preflight\n  - takeoff\n"
AT = "  - inject: {fault: freeze, vehicle: U1, at: {"


@pytest.mark.parametrize(
    ("stages", "place", "words"),
    [
        ("  - takeof\n", "0:5", "stages.0.takeof: unknown key; did you mean 'takeoff'? (allowed are arm, connect"),
        ("  - {}\n", "0:5", "stages.0: a stage is one word, or one word with its settings"),
        ("  - 7\n", "0:5", "stages.0: a stage is one word"),
        ("  - [relay]\n", "0:5", "stages.0: a stage is one word"),
        ("  - {hold: {for_s: 1}, wait: {for_s: 1}}\n", "0:5", "stages.0: a stage is one word"),
        ("  relay: {}\n", "-1:1", "stages: Input should be a valid list"),
        ("  []\n", "-1:1", "stages: List should have at least 1 item"),
        (UP + "  - relay: {timeout: 3}\n", "2:13", "stages.2.relay.timeout: unknown key; did you mean 'timeout_s'?"),
        (UP + "  - relay: {timeout_s: 0}\n", "2:13", "stages.2.relay.timeout_s: Input should be greater than 0, found"),
        (UP + "  - relay: {timeout_s: soon}\n", "2:13", "stages.2.relay.timeout_s: Input should be a valid number"),
        (UP + "  - relay: {retries: 2}\n", "2:13", "stages.2.relay.retries: unknown key"),
        (UP + "  - relay: {on_failure: panic}\n", "2:13", "stages.2.relay.on_failure: Input should be 'hold', 'skip'"),
        (UP + "  - relay: 3\n", "2:5", "stages.2.relay: Input should be a valid dictionary"),
        (UP + "  - relay: {name: a/b}\n", "2:13", "stages.2.relay.name: String should match pattern"),
        (UP + "  - relay: {expect: {outcom: formed}}\n", "2:22", "stages.2.relay.expect.outcom: unknown figure; did y"),
        (UP + "  - relay: {expect: {outcome: great}}\n", "2:22", "stages.2.relay.expect.outcome: outcome is one of"),
        (UP + "  - relay: {expect: {placement_error_m.U9: 1}}\n", "2:22", "stages.2.relay.expect.placement_error_m.U9"),
        (UP + "  - relay: {expect: {stage_duration_s.land: 1}}\n", "2:22", "stages.2.relay.expect.stage_duration_s.la"),
        (UP + "  - hold\n", "2:5", "stages.2.hold.for_s: is missing"),
        (UP + "  - hold: {for_s: -1}\n", "2:12", "stages.2.hold.for_s: Input should be greater than 0, found -1"),
        (UP + "  - measure: {every_s: 0}\n", "2:15", "stages.2.measure.every_s: Input should be greater than or equal"),
        ("  - prompt: {text: ''}\n", "0:14", "stages.0.prompt.text: String should have at least 1 character"),
        ("  - takeoff\n", "0:5", "stages.0.takeoff: needs a preflight before it"),
        ("  - arm\n", "0:5", "stages.0.arm: needs a preflight before it"),
        (UP + "  - arm\n", "2:5", "stages.2.arm: belongs before takeoff"),
        (UP + "  - takeoff\n", "2:5", "stages.2.takeoff: there is one takeoff in a run"),
        (UP + "  - relay\n  - relay\n", "3:5", "stages.3.relay: there is one relay in a run"),
        ("  - preflight\n  - relay\n", "1:5", "stages.1.relay: needs a takeoff before it"),
        ("  - hold: {for_s: 1}\n", "0:5", "stages.0.hold: needs a takeoff before it"),
        (UP + "  - relay\n  - plan\n", "3:5", "stages.3.plan: belongs before the relay"),
        (UP + "  - relay\n  - locate\n", "3:5", "stages.3.locate: belongs before the relay"),
        (UP + "  - land\n  - hold: {for_s: 1}\n", "3:5", "stages.3.hold: nobody flies any more after land"),
        (UP + "  - return\n  - land\n", "3:5", "stages.3.land: nobody flies any more after return"),
        (UP + "  - wait: {for_s: 1, name: takeoff}\n", "2:22", "stages.2.wait.name: 'takeoff' is the name of an earli"),
        ("  - emission: {}\n", "0:5", "stages.0.emission: nobody is switched"),
        ("  - emission: {on: [U4]}\n", "0:21", "stages.0.emission.on.0: 'U4' is nobody of this playbook"),
        ("  - emission: {on: [U1], off: [L0, U1]}\n", "0:36", "stages.0.emission.off.1: U1 is to be on and off"),
        ("  - inject: {fault: storm}\n", "0:14", "stages.0.inject.fault: Input should be 'pilot', 'sensor_silent'"),
        ("  - inject: {fault: pilot}\n", "0:5", "stages.0.inject.vehicle: is missing: whom does pilot strike?"),
        ("  - inject: {fault: pilot, vehicle: U11}\n", "0:28", "stages.0.inject.vehicle: 'U11' is no UAV; did you mea"),
        ("  - inject: {fault: freeze, vehicle: L1}\n", "0:29", "stages.0.inject.vehicle: 'L1' is no UAV"),
        ("  - inject: {fault: sensor_silent, vehicle: L0}\n", "0:36", "stages.0.inject.vehicle: 'L0' is no receiver "),
        ("  - inject: {fault: router_killed, vehicle: U1}\n", "0:36", "stages.0.inject.vehicle: router_killed strikes"),
        ("  - inject: {fault: reboot}\n", "0:5", "stages.0.inject.vehicle: is missing: whom does reboot strike?"),
        ("  - inject: {fault: link_faults, vehicle: U1}\n", "0:5", "stages.0.inject: nothing fails: it takes one or"),
        ("  - inject: {fault: link_faults, vehicle: U1, loss: 2}\n", "0:47", "stages.0.inject.loss: Input should be"),
        ("  - inject: {fault: freeze, vehicle: U1, loss: 0.1}\n", "0:42", "stages.0.inject.loss: goes with link_"),
        ("  - inject: {fault: router_frozen, vehicle: U1}\n", "0:36", "stages.0.inject.vehicle: router_frozen strikes"),
        ("  - inject: {fault: pilot, vehicle: U1, for_s: 3}\n", "0:41", "stages.0.inject.for_s: pilot does not end by"),
        (AT + "receiver: U1, state: LEG_1}}\n", "0:42", "stages.0.inject.at: no relay comes"),
        (AT + "receiver: X, state: LEG_1}}\n", "0:47", "stages.0.inject.at.receiver: 'X' is no"),
        (AT + "receiver: U1, state: FLYING}}\n", "0:61", "stages.0.inject.at.state: Input"),
        (AT + "state: LEG_1}}\n", "0:42", "stages.0.inject.at.receiver: is missing"),
        (
            "  - inject: {fault: freeze, vehicle: U1, after_s: 1, at: {receiver: U1, state: LEG_1}}\n" + UP,
            "0:42", "stages.0.inject.after_s: it strikes at a moment of the relay",
        ),
    ],
)  # fmt: skip
def test_each_problem_with_its_place_and_what_is_allowed(tmp_path: Path, stages: str, place: str, words: str) -> None:
    line, column = map(int, place.split(":"))
    found = problems(tmp_path, HEAD + stages)
    assert any(problem.startswith(f"{line + FIRST_LINE}:{column}: {words}") for problem in found), found


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        ("reboot, vehicle: U1, for_s: 3", ".for_s: reboot does not end by itself"),
        ("clock_step, vehicle: U1, step_s: 1, for_s: 3", ".for_s: clock_step does not end by itself"),
        ("service_killed, for_s: 3", ".for_s: service_killed does not end by itself"),
        ("service_frozen", ".for_s: is missing: service_frozen would last for ever, and so would the run"),
        ("disk_full, vehicle: U1", ".vehicle: disk_full strikes no vehicle"),
        ("sensor_bias, vehicle: U1", ": nothing fails: it takes bias_deg, other than 0"),
        ("sensor_bias, vehicle: U1, jump_deg: 3", ".jump_deg: goes with sensor_jump, not with sensor_bias"),
        ("sensor_bias, vehicle: U1, bias_deg: 181", ".bias_deg: Input should be less than or equal to 180"),
        ("report_faults, vehicle: U1", ": nothing fails: it takes one or more of loss, duplication, reordering"),
        ("report_faults, vehicle: L0, loss: 0.1", ".vehicle: 'L0' is no receiver (allowed are"),
        ("sensor_stuck, vehicle: L0", ".vehicle: 'L0' is no receiver"),
        ("sensor_stuck", ".vehicle: is missing: whom does sensor_stuck strike?"),
        ("sensor_stuck, vehicle: U1, of: L0", ".of: goes with sensor_bias or sensor_jump, not with sensor_stuck"),
        ("sensor_jump, vehicle: U1, jump_deg: 9, of: L9", ".of: 'L9' is no transmitter (allowed are L0, L1"),
        ("sensor_jump, vehicle: U1, jump_deg: 9, of: U1", ".of: U1 does not hear itself"),
        ("transmitter_silent, vehicle: X", ".vehicle: 'X' is no transmitter (allowed are L0, L1, U1"),
        ("transmitter_drift, vehicle: L1, speed_mps: 1", ".vehicle: 'L1' is no UAV"),
        ("transmitter_drift, vehicle: L0", ": nothing fails: it takes speed_mps, other than 0"),
        ("freeze, vehicle: L0, course_deg: 90", ".course_deg: goes with transmitter_drift, not with freeze"),
    ],
)
def test_what_does_not_fit_a_fault_is_said_where_it_stands(tmp_path: Path, fault: str, words: str) -> None:
    found = problems(tmp_path, HEAD + f"  - inject: {{fault: {fault}}}\n")
    assert any(f"stages.0.inject{words}" in problem for problem in found), found


def test_problems_of_the_stages_are_said_with_all_others(tmp_path: Path) -> None:
    text = HEAD.replace("radius_m: 60", "radius_m: -1") + "  - relay\n  - emission: {on: [X]}\nflight: {speed: 3}\n"
    assert len(problems(tmp_path, text)) == 4


@pytest.mark.parametrize(
    ("more", "place", "words"),
    [
        ("flight: {land_after: true}\n", (1, 10), "flight.land_after: with stages, landing is one of them"),
        ("target: vehicles\n", (1, 1), "target: there are no vehicles: name how each is reached"),
        ("target: moon\n", (1, 1), "target: Input should be 'embedded', 'ardupilot', 'px4' or 'vehicles'"),
        ("target: px4\n", (-1, 14), "stages.0.inject.fault: pilot needs a link of its own"),
        ("seed: -1\n", (1, 1), "seed: Input should be greater than or equal to 0"),
        ("slow: often\n", (1, 1), "slow: Input should be a valid boolean"),
        ("expect: {placement_error_m.U7: 1}\n", (1, 10), "expect.placement_error_m.U7: 'U7' is no receiver here"),
        ("expect: [formed]\n", (1, 1), "expect: expectations are a mapping"),
    ],
)
def test_what_the_rest_of_a_playbook_says_of_its_stages(
    tmp_path: Path, more: str, place: tuple[int, int], words: str
) -> None:
    stages = "  - inject: {fault: pilot, vehicle: U1}\n"
    line, column = place
    line += FIRST_LINE + 0 if line > 0 else FIRST_LINE + 1
    assert any(f"{line}:{column}: {words}" in problem for problem in problems(tmp_path, HEAD + stages + more))


@pytest.mark.parametrize("fault", ["sensor_stuck, vehicle: U1", "transmitter_silent, vehicle: L1"])
def test_faults_are_not_injected_into_real_sensors(tmp_path: Path, fault: str) -> None:
    stages = f"  - inject: {{fault: {fault}}}\nsensor: {{simulated: false}}\n"
    words = f"stages.0.inject.fault: {fault.partition(',')[0]} needs simulated sensors: see sensor.simulated"
    assert problems(tmp_path, HEAD + stages) == [f"{FIRST_LINE}:14: {words}"]


def test_faults_are_not_injected_into_real_vehicles(tmp_path: Path) -> None:
    vehicles = "vehicles:\n" + "".join(
        f"  {name}: {{link: 'udpin:127.0.0.1:1455{number}', system_id: {number + 1}}}\n"
        for number, name in enumerate(("L0", "U1", "U2", "U3"))
    )
    stages = "  - inject: {fault: freeze, vehicle: U1}\n"
    words = "stages.0.inject: faults are injected into simulated vehicles only: see target"
    assert problems(tmp_path, HEAD + stages + vehicles) == [f"{FIRST_LINE}:5: {words}"]
    assert load(tmp_path, HEAD + stages + vehicles + "target: embedded\n").flow
    own_router = "bus: {router: 'tcp/10.0.0.1:7447'}\n"
    assert (
        "the bus router is not this run's own"
        in problems(tmp_path, HEAD + "  - inject: {fault: router_killed}\n" + own_router)[0]
    )
