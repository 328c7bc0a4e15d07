"""A router by itself, as a process: it outlives nobody who began it."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from drivers.bus.certificates import Authority, now
from drivers.bus.security import ROUTER, configurations
from drivers.simulation.launcher import free_tcp_port


@pytest.mark.slow
@pytest.mark.parametrize("protocol", ["tcp", "tls"])
def test_a_router_ends_with_the_process_that_began_it(tmp_path: Path, protocol: str) -> None:
    endpoint, keys = f"{protocol}/127.0.0.1:{free_tcp_port()}", tmp_path / "router.json5"
    command = [sys.executable, "-m", "drivers.bus.router", endpoint, "--parent-pid", str(os.getpid() + 1)]
    if protocol == "tls":
        keys.touch(mode=0o600)
        keys.write_text(configurations("eight", ["U1"], endpoint, Authority("eight", now(), valid_days=2))[ROUTER])
        command += ["--keys", str(keys)]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (0, "")
