"""The library of playbooks, flown by the real command on embedded copters: every expectation comes true."""

from __future__ import annotations

import contextlib
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

import pytest

from gcs.playbook.loader import load_runs
from tests.gcs.expectations.damages import CONFIGS

pytestmark = [pytest.mark.slow, pytest.mark.alone, pytest.mark.timeout(420)]

LIBRARY = {path.stem: path for path in sorted((CONFIGS / "playbooks").glob("*.yaml"))}
RUNS = {stem: load_runs(path) for stem, path in LIBRARY.items()}
CROWDED = ["paper_20"]
"""Flies so many vehicles that nothing else may fly beside it."""
LONG = ["paper_8", "noise_sweep", "dress_rehearsal"]
"""Takes as long as all the others one after another."""
SHORT = [stem for stem in LIBRARY if stem not in LONG + CROWDED]


@dataclass
class Session:
    """The command under way."""

    folder: Path
    process: subprocess.Popen[str]

    def ended(self) -> tuple[int, str, list[ElementTree.Element]]:
        """Return exit status, what was said, and the suites of the JUnit file."""
        said, _ = self.process.communicate(timeout=400)
        return self.process.returncode, said, list(ElementTree.parse(self.folder / "junit.xml").getroot())


@contextlib.contextmanager
def flying(folder: Path, playbooks: list[Path], speedup: float) -> Iterator[Session]:
    folder.mkdir(exist_ok=True)
    options = ["--slow", "--speedup", f"{speedup}", "--junit", str(folder / "junit.xml")]
    process = subprocess.Popen(
        [sys.executable, "-m", "gcs.cli", "test", *map(str, playbooks), *options, "--runs-dir", str(folder / "runs")],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=CONFIGS.parent,
    )  # fmt: skip
    try:
        yield Session(folder, process)
    finally:
        process.kill()
        process.wait()


def require_passed(session: Session, stems: list[str]) -> None:
    status, said, suites = session.ended()
    assert status == 0, said
    assert len(suites) == sum(len(RUNS[stem]) for stem in stems)
    for suite in suites:
        assert (suite.attrib["failures"], suite.attrib["errors"], suite.attrib["skipped"]) == ("0", "0", "0")
        assert int(suite.attrib["tests"]) >= 3
    assert len(list((session.folder / "runs").glob("*/report.html"))) == len(suites)


def test_every_playbook_does_what_it_expects(tmp_path: Path) -> None:
    assert len(SHORT) >= 10
    with (
        flying(tmp_path / "short", [LIBRARY[stem] for stem in SHORT], speedup=8) as short,
        flying(tmp_path / "long", [LIBRARY[stem] for stem in LONG], speedup=8) as long,
    ):
        require_passed(short, SHORT)
        require_passed(long, LONG)


def test_the_crowded_one_does_what_it_expects(tmp_path: Path) -> None:
    with flying(tmp_path, [LIBRARY[stem] for stem in CROWDED], speedup=6) as session:
        require_passed(session, CROWDED)


def test_what_does_not_come_true_fails_with_what_was_measured(tmp_path: Path) -> None:
    hopeless = tmp_path / "hopeless.yaml"
    text = LIBRARY["formation_line"].read_text()
    hopeless.write_text(text.partition("expect:")[0] + "stages: [preflight]\nexpect: {receivers_placed: 3}\n")
    with flying(tmp_path, [hopeless], speedup=8) as session:
        status, said, [suite] = session.ended()
    assert status == 1, said
    assert suite.attrib["failures"] == "1"
    [failure] = suite.iter("failure")
    assert failure.attrib["message"] == "receivers_placed 0, expected == 3"
    assert "report.html" in said
