"""A relay on sensors that show whole degrees: it forms, breaks off no leg, and notices one that is stuck."""

from __future__ import annotations

import math

import msgspec
import pytest

from drivers.bus.messages import BearingReport, decode, encode
from gcs.relay.repetition import STEPS_UNCHANGED
from gcs.relay.states import ReceiverState
from tests.gcs.relay.world import World

STEP_RAD = math.radians(1.0)
FARTHEST_M = 110.0
"""No transmitter that a receiver hears is farther off."""


class InSteps(World):
    """The paper's UAVs; their sensors' readings are rounded, and U1's are all one from `stuck_from_s` on."""

    def __init__(self, step_rad: float = STEP_RAD, stuck_from_s: float = math.inf) -> None:
        super().__init__(sigma_deg=0.05)
        self.tamper = self._shown
        self.step_rad, self.stuck_from_s = step_rad, stuck_from_s
        self.stuck_at: complex | None = None
        self._last = BearingReport(0, 0, "true_north", [])

    def _shown(self, name: str, payload: bytes) -> bytes:
        report = decode(payload, BearingReport)
        if name == "U1" and self.clock.now_s() > self.stuck_from_s:
            report = msgspec.structs.replace(report, bearings=self._last.bearings)
            self.stuck_at = self.vehicles["U1"].place if self.stuck_at is None else self.stuck_at
        elif name == "U1":
            self._last = report
        if not self.step_rad:
            return encode(report)
        bearings = [
            msgspec.structs.replace(bearing, azimuth_rad=round(bearing.azimuth_rad / self.step_rad) * self.step_rad)
            for bearing in report.bearings
        ]
        return encode(msgspec.structs.replace(report, bearings=bearings, resolution_rad=self.step_rad))

    def placed(self) -> list[str]:
        return [name for name, state in self.states().items() if state is ReceiverState.PLACED]


async def test_receivers_stand_within_a_step_and_no_leg_is_broken_off() -> None:
    """The third one flies by the first two."""
    world = InSteps()
    await world.run(until=lambda: len(world.placed()) == 3)
    assert len(world.placed()) == 3
    assert max(world.errors_m()[name] for name in world.placed()) < FARTHEST_M * STEP_RAD
    assert not any("zero velocity" in reason for *_, reason in world.history)


@pytest.mark.parametrize("stuck_from_s", [103.0, 105.0])
async def test_a_stuck_one_flies_on_for_no_longer_than_its_steps_explain(stuck_from_s: float) -> None:
    """Beside what one without steps flies on, which is found at once: until the gap is over, and to brake."""
    flown_m = {}
    for step_rad in (0.0, STEP_RAD):
        world = InSteps(step_rad, stuck_from_s)
        await world.run(until=lambda: world.states()["U1"] is ReceiverState.HELD)  # noqa: B023 - called in here
        assert world.states()["U1"] is ReceiverState.HELD
        assert world.stuck_at is not None
        flown_m[step_rad] = abs(world.vehicles["U1"].place - world.stuck_at)
    assert flown_m[STEP_RAD] < flown_m[0.0] + STEPS_UNCHANGED * STEP_RAD * FARTHEST_M
