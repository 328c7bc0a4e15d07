"""Settings are changed by name; what is no setting, or no value, is said with the way out."""

from __future__ import annotations

import pytest

from gcs.errors import ServiceError
from gcs.recording.topics import decoded, monitor_topic
from gcs.replay.settings import NAMES, changed, read_changes
from gcs.stop_monitor import SLOT, TURN
from tests.gcs.replay.legs import fly_run

TURN_MADE, SLOT_MADE = (
    note.made
    for _, topic, payload in fly_run(trim=False)
    if topic == monitor_topic("U1") and (note := decoded(payload, topic)).made is not None
)


def test_a_setting_is_changed_for_its_kind_of_leg_only() -> None:
    changes = read_changes(["monitor.slot.band_m=0.5", "monitor.slot.dwell_s=2"])
    assert changed(TURN_MADE, changes) == TURN_MADE
    rule = changed(SLOT_MADE, changes).rule
    assert (rule.band_m, rule.dwell_s) == (0.5, 2.0)
    assert (rule.on_line, rule.sway_m, rule.widest_m) == (SLOT.on_line, SLOT.sway_m, SLOT.widest_m)


def test_every_name_can_be_set() -> None:
    assert {"monitor.turn.band_m", "monitor.slot.widest_m"} <= set(NAMES)
    for name in NAMES:
        changes = read_changes([f"{name}=0.123"])
        assert any("0.123" in str(changed(made, changes)) for made in (TURN_MADE, SLOT_MADE))


def test_nothing_is_set_where_nothing_is_changed() -> None:
    assert changed(TURN_MADE, {}) == TURN_MADE
    assert (TURN_MADE.rule, SLOT_MADE.rule) == (TURN, SLOT)


@pytest.mark.parametrize(
    ("setting", "said"),
    [
        ("monitor.slot.bandm=1", "did you mean monitor.slot.band_m?"),
        ("monitor.turn.dwel_s=1", "did you mean monitor.turn.dwell_s?"),
        ("slot.sway_m=1", "did you mean monitor.slot.sway_m?"),
        ("", "there is no"),
        ("monitor.slot.on_line=1", "did you mean"),
        ("monitor.slot.band_m", "takes a number above 0"),
        ("monitor.slot.band_m=wide", "as in --set monitor.slot.band_m=0.5"),
        ("monitor.slot.band_m=nan", "takes a number above 0"),
        ("monitor.slot.band_m=-1", "takes a number above 0"),
        ("monitor.slot.band_m=0", "takes a number above 0"),
        ("monitor.slot.dwell_s=inf", "takes a number above 0"),
    ],
)
def test_what_cannot_be_set_is_said(setting: str, said: str) -> None:
    with pytest.raises(ServiceError) as raised:
        read_changes([setting])
    assert said in str(raised.value)
