"""Two hundred and more spoilt playbooks: each is refused where it is spoilt, in words, and never with a traceback."""

from __future__ import annotations

from pathlib import Path

import pytest

from gcs.playbook.loader import PlaybookError, load_runs
from tests.gcs.expectations.damages import READY, Damage, damages

SPOILT = damages(seed=6, most=260)


def test_there_are_enough_of_every_kind() -> None:
    kinds = {damage.name.split()[0] for damage in SPOILT}
    assert len(SPOILT) >= 200
    assert len({damage.text for damage in SPOILT}) >= 200
    assert len(kinds) >= 10
    assert len(READY) >= 15


@pytest.mark.parametrize("damage", SPOILT, ids=lambda damage: damage.name)
def test_what_is_spoilt_is_said_where_it_is(tmp_path: Path, damage: Damage) -> None:
    path = tmp_path / "spoilt.yaml"
    path.write_text(damage.text, encoding="utf-8")
    with pytest.raises(PlaybookError) as caught:
        load_runs(path)
    assert all(problem.message for problem in caught.value.problems)
    found = [problem.line for problem in caught.value.problems]
    assert any(damage.first <= line <= damage.last for line in found), str(caught.value)
    for line in str(caught.value).splitlines():
        assert line.startswith(f"{path}:")
