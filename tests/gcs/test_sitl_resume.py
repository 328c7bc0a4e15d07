"""A service killed in mid-leg over real autopilots that outlive it, and `resume`."""

from __future__ import annotations

import asyncio
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.gcs.field import Field, open_field
from tests.gcs.test_resume import kill
from tests.gcs.test_sitl import Real, on_both, real

__all__ = ["real"]

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]


class Resumed:
    """The command under way, and what it has said."""

    def __init__(self, field: Field) -> None:
        self._field, self.begun_s = field, time.monotonic()
        self.said = ""

    async def run(self) -> int:
        """Run it to its end; return its exit status."""
        (run,) = self._field.runs_dir.iterdir()
        words = ("-m", "gcs.cli", "resume", str(run), "--attended")
        process = await asyncio.create_subprocess_exec(
            sys.executable, *words, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT
        )
        assert process.stdout is not None
        try:
            while line := await process.stdout.readline():
                self.said = " ".join((self.said + line.decode()).split()) + " "
            return await process.wait()
        finally:
            if process.returncode is None:
                process.kill()

    async def until(self, words: str) -> None:
        """Wait until it says these words."""
        await until(lambda: words in self.said, words)


async def until(condition: Callable[[], bool], what: str, timeout_s: float = 30.0) -> None:
    deadline_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline_s, f"not in time: {what}"
        await asyncio.sleep(0.02)


async def give_back(field: Field, real: Real, resumed: Resumed) -> None:
    """Release every vehicle as an operator does, and switch it to its guided mode as its pilot does."""
    await resumed.until("waiting for the operator: bearing-relay control release L0")
    for name, wire in field.wires.items():
        assert max(wire.setpoints) < resumed.begun_s, f"{name} was streamed to unasked"
        await field.say("release", name)
        await until(lambda wire=wire: max(wire.setpoints) > resumed.begun_s, f"stream to {name}")
        await asyncio.sleep(1.0)
        wire.command(1, real.guided >> 16)
        await until(lambda wire=wire: wire.modes[-1][1] == real.guided, f"guided mode of {name}")
    await resumed.until("waiting for the operator: bearing-relay control resume")
    assert (await field.say("resume")).ok


@on_both
async def test_a_service_killed_in_mid_leg_is_resumed_and_forms(real: Real, tmp_path: Path) -> None:
    async with open_field(tmp_path, real.sitl) as field:
        await field.until_moving()
        await asyncio.sleep(1.0)
        await kill(field)
        resumed = Resumed(field)
        running = asyncio.create_task(resumed.run())
        if real.leaves_guided:
            await give_back(field, real, resumed)
        status = await running
        print(resumed.said)
        assert status == 0, resumed.said
        report = field.report()
        (receiver,) = report["receivers"]
        print(f"placement error {receiver['placement_error_m']:.2f} m")
        assert report["outcome"] == "formed"
        assert receiver["placement_error_m"] < 1.0
