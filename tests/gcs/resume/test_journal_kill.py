"""A process killed while it writes its journal: what is on the disk afterwards."""

from __future__ import annotations

import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.recording.journal import open_journal, relay_line
from gcs.recording.journal_reading import read_journal

pytestmark = pytest.mark.slow

LOST_S = 0.1
WRITER = """
import sys, time
from pathlib import Path
from gcs.recording.journal import open_journal, relay_line

with open_journal(Path(sys.argv[1])) as journal:
    while True:
        now_ns = time.time_ns()
        print(now_ns, flush=True)
        journal.append(relay_line(now_ns, "x" * 2000, (), ()))
        time.sleep(0.02)
"""


def test_kill_9_loses_no_more_than_the_last_tenth_of_a_second(tmp_path: Path) -> None:
    path, rng = tmp_path / "journal.jsonl", random.Random(9)
    for kills in range(1, 4):
        before = path.read_bytes() if path.exists() else b""
        with subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True) as writer:
            while not path.exists() or path.stat().st_size <= len(before):
                assert writer.poll() is None
                time.sleep(0.01)
            time.sleep(rng.uniform(0.2, 0.5))
            killed_ns = time.time_ns()
            writer.send_signal(signal.SIGKILL)
            assert writer.stdout is not None
            told_ns = [int(line) for line in writer.stdout if line.endswith("\n")]
        assert path.read_bytes().startswith(before)
        read = read_journal(path)
        assert len(read.lost) <= kills
        assert len(told_ns) > 5
        assert read.entries[-1].time_ns >= max(at_ns for at_ns in told_ns if at_ns < killed_ns - LOST_S * 1e9)
    with open_journal(path) as journal:
        journal.append(relay_line(1, "the next service", (), ()))
    assert read_journal(path).entries[-1].time_ns == 1
