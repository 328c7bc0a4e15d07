"""What a playbook may say about links, and what is refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.playbook.loader import PlaybookError, load_playbook
from gcs.playbook.schema import Playbook

HEAD = """\
playbook: 1
name: links
formation: {kind: custom, slots: {O1: [70, 60]}}
transmitters: {L0: {at: [0, 0], beacon: true}, L1: {at: [100, 0]}}
receivers: {U1: {start: [20, 30]}}
"""


def load(tmp_path: Path, text: str) -> Playbook:
    path = tmp_path / "links.yaml"
    path.write_text(HEAD + text)
    return load_playbook(path)


def test_a_vehicle_has_a_preferred_link_and_fallbacks(tmp_path: Path) -> None:
    playbook = load(
        tmp_path,
        """\
vehicles:
  L1: {link: "udpin:127.0.0.1:14551", system_id: 2}
  U1:
    link: "udpin:127.0.0.1:14552"
    fallback: ["tcp:127.0.0.1:5760"]
    system_id: 3
    autopilot: px4
    signing: {key_variable: RELAY_KEY}
""",
    )
    assert playbook.vehicles is not None
    assert playbook.vehicles["U1"].links == ("udpin:127.0.0.1:14552", "tcp:127.0.0.1:5760")
    assert playbook.vehicles["U1"].signing is not None
    assert playbook.vehicles["U1"].signing.key_variable == "RELAY_KEY"
    assert playbook.vehicles["L1"].autopilot is None


@pytest.mark.parametrize(
    ("l1", "u1", "words"),
    [
        ('link: "udpin:h:1", system_id: 2', 'link: "udpin:h:1", system_id: 2', "both system id 2 on udpin:h:1"),
        ('link: "udpin:h:1", system_id: 2', 'link: "udpin:h:2", fallback: ["udpin:h:1"], system_id: 2', "both system"),
        ('link: "udpin:h:1", system_id: 2', 'link: "udpin:h:2", fallback: ["udpin:h:2"], system_id: 3', "link twice"),
        ('link: "udpin:h:1", system_id: 254', 'link: "udpin:h:2", system_id: 3', "this service's own"),
        (
            'link: "udpin:h:1", system_id: 2, signing: {key_variable: A}',
            'link: "udpin:h:1", system_id: 3, signing: {key_variable: B}',
            "share udpin:h:1 but not its signing key",
        ),
        (
            'link: "udpin:h:1", system_id: 2, signing: {key_variable: A, key_file: b}',
            'link: "udpin:h:2", system_id: 3',
            "name exactly one",
        ),
        ('link: "udpin:h:1", system_id: 2, signing: {}', 'link: "udpin:h:2", system_id: 3', "name exactly one"),
    ],
)
def test_vehicles_that_clash_are_refused(tmp_path: Path, l1: str, u1: str, words: str) -> None:
    with pytest.raises(PlaybookError) as refused:
        load(tmp_path, f"vehicles:\n  L1: {{{l1}}}\n  U1: {{{u1}}}\nmavlink: {{system_id: 254}}\n")
    assert words in str(refused.value)
