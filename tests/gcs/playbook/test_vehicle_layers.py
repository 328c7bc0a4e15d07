"""Fleet, type and vehicle: nothing is written twice, the later wins; and the same playbook flies on every target."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.errors import ServiceError
from gcs.playbook.loader import PlaybookError, load_playbook
from gcs.playbook.schema import Playbook
from gcs.playbook.target import aimed

HEAD = """\
playbook: 1
name: layers
formation: {kind: custom, slots: {O1: [70, 60], O2: [30, 80]}}
transmitters: {L0: {at: [0, 0], beacon: true}, L1: {at: [100, 0]}}
receivers: {U1: {start: [20, 30]}, U2: {start: [50, -20]}}
"""
LAYERS = """\
fleet: {autopilot: px4, signing: {key_variable: FLEET_KEY}, fallback: ["udpin:127.0.0.1:9"]}
vehicle_types:
  radio: {link: "serial:/dev/ttyUSB0:57600", autopilot: ardupilot}
vehicles:
  L1: {type: radio, system_id: 1}
  U1: {type: radio, system_id: 2, autopilot: px4, signing: {key_variable: FLEET_KEY}}
  U2: {link: "udpin:127.0.0.1:14550", system_id: 3, fallback: []}
"""


def load(tmp_path: Path, text: str) -> Playbook:
    path = tmp_path / "layers.yaml"
    path.write_text(HEAD + text)
    return load_playbook(path)


def test_the_later_layer_wins(tmp_path: Path) -> None:
    vehicles = load(tmp_path, LAYERS).vehicles
    assert vehicles is not None
    assert {name: at.autopilot for name, at in vehicles.items()} == {"L1": "ardupilot", "U1": "px4", "U2": "px4"}
    assert vehicles["L1"].links == ("serial:/dev/ttyUSB0:57600", "udpin:127.0.0.1:9")
    assert vehicles["U2"].links == ("udpin:127.0.0.1:14550",)
    assert {at.signing.key_variable for at in vehicles.values() if at.signing} == {"FLEET_KEY"}


def test_what_a_run_leaves_reads_back_the_same(tmp_path: Path) -> None:
    playbook = load(tmp_path, LAYERS)
    assert Playbook.model_validate(playbook.model_dump(mode="json")) == playbook


@pytest.mark.parametrize(
    ("found", "instead", "expected"),
    [
        ("autopilot: px4, signing", "autopilto: px4, signing", "6:9: fleet.autopilto: unknown key; did you mean 'auto"),
        ("autopilot: ardupilot}", "autopilot: betaflight}", "8:46: vehicle_types.radio.autopilot: Input should be"),
        ("type: radio, system_id: 1", "type: radoi, system_id: 1", "10:8: vehicles.L1.type: 'radoi' is no type of"),
        ("type: radio, system_id: 1", "type: radio", "10:3: vehicles.L1.system_id: is missing"),
        ('link: "udpin:127.0.0.1:14550", ', "", "12:3: vehicles.U2.link: is missing"),
        ("type: radio, system_id: 1", "tpye: radio, system_id: 1", "10:8: vehicles.L1.tpye: unknown key; did you mean"),
        ("system_id: 2", "system_id: 1", "9:1: vehicles: L1 and U1 are both system id 1"),
        ('"serial:/dev/ttyUSB0:57600"', '"serial:x"', "8:11: vehicle_types.radio.link: link 'serial:x' is not"),
        ("  L1: {type: radio, system_id: 1}\n", "", "9:1: vehicles: L1 have no link"),
    ],
)  # fmt: skip
def test_each_problem_at_its_place(tmp_path: Path, found: str, instead: str, expected: str) -> None:
    with pytest.raises(PlaybookError) as caught:
        load(tmp_path, LAYERS.replace(found, instead))
    told = [f"{problem.line}:{problem.column}: {problem.message}" for problem in caught.value.problems]
    assert [problem for problem in told if problem.startswith(expected)], told


def test_the_same_playbook_flies_on_every_target(tmp_path: Path) -> None:
    playbook = load(tmp_path, LAYERS)
    assert aimed(playbook).target == "vehicles"
    assert aimed(playbook).vehicles == playbook.vehicles
    for target in ("embedded", "ardupilot", "px4"):
        simulated = aimed(playbook, target)
        assert (simulated.target, simulated.vehicles) == (target, None)
        assert simulated.plan() == playbook.plan()
    assert aimed(load(tmp_path, LAYERS + "target: embedded\n")).vehicles is None
    assert aimed(load(tmp_path, LAYERS + "target: embedded\n"), "vehicles").vehicles == playbook.vehicles
    assert aimed(load(tmp_path, "")).target == "embedded"


def test_what_cannot_be_flown_on_a_target_says_why(tmp_path: Path) -> None:
    with pytest.raises(ServiceError, match="layers cannot be flown on vehicles: target: there are no vehicles"):
        aimed(load(tmp_path, ""), "vehicles")
    faulty = load(tmp_path, LAYERS + "target: embedded\nstages: [{inject: {fault: freeze, vehicle: U1}}]\n")
    with pytest.raises(ServiceError, match=r"stages\.0\.inject: faults are injected into simulated vehicles only"):
        aimed(faulty, "vehicles")
