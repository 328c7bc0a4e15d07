"""One leg of one receiver, flown on a setpoint lease that only fresh, accepted bearings renew."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamState
from gcs.bearings import Observation, Observations
from gcs.errors import HoldRequiredError
from gcs.guidance import leg_velocity
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.stop_monitor import StopMonitor
from planner.angles import wrap
from planner.frames import FormationFrame
from planner.plan import Leg

Announce = Callable[[ReceiverRecord], None]


class SetpointLease(Protocol):
    """What the relay may do to a vehicle."""

    @property
    def state(self) -> StreamState:
        """Whether setpoints leave now; PILOT when somebody else has the vehicle."""
        ...

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Fly this velocity until the lease ends."""
        ...

    def stop(self) -> None:
        """Fly zero velocity, then be silent."""
        ...


@dataclass
class LegFlight:
    """A leg and everything needed to fly it. `objection` says why the receiver must not move now, or None."""

    record: ReceiverRecord
    monitor: StopMonitor
    lease: SetpointLease
    observations: Observations
    objection: Callable[[], str | None]
    announce: Announce
    frame: FormationFrame
    clock: Clock
    settings: RelaySettings
    _usable_s: float = field(default=0.0, init=False)
    _angle_errors_rad: list[float] = field(default_factory=list, init=False)

    async def fly(self) -> None:
        """Fly until the stop condition holds, then command zero velocity. HoldRequiredError when it must hold."""
        leg = self.monitor.leg
        flown = LegRecord(leg, started_s=self.clock.now_s())
        self.record.legs.append(flown)
        self._usable_s = flown.started_s
        deadline_s = flown.started_s + self.settings.longest_leg_s(leg)
        while not await self._step(flown):
            if self.clock.now_s() > deadline_s:
                raise HoldRequiredError(f"the leg took longer than {self.settings.longest_leg_s(leg):.0f} s")
        self.lease.stop()
        flown.ended_s = self.clock.now_s()
        flown.stop_angle_error_rad = sum(self._angle_errors_rad) / len(self._angle_errors_rad)

    async def _step(self, flown: LegRecord) -> bool:
        """Take the next observation and steer by it; True when the leg has ended."""
        observation = await self.observations.next(self.settings.gap_s)
        now_s = self.clock.now_s()
        problem = self.objection()
        if problem is None and observation is not None and self._accepted(observation):
            self._usable_s = now_s
            return self._steer(flown, observation, now_s)
        problem = problem or self._overdue(observation, now_s)
        if problem is not None:
            self._suspend(problem, now_s)
        return False

    def _accepted(self, observation: Observation) -> bool:
        """Return whether an observation holds what the leg needs and agrees with it."""
        return not self._missing(observation) and self.monitor.observe(
            observation.captured_s, observation.directions_rad, observation.sigma_rad
        )

    def _missing(self, observation: Observation) -> set[str]:
        leg = self.monitor.leg
        return {leg.guide, *leg.stop_reference} - observation.directions_rad.keys()

    def _overdue(self, observation: Observation | None, now_s: float) -> str | None:
        """Return what has been wrong with the bearings for too long, in words, or None."""
        if observation is None:
            return f"no bearing report from its sensor for {self.settings.gap_s:g} s"
        if now_s - self._usable_s < self.settings.gap_s:
            return None
        missing = self._missing(observation)
        return f"it does not hear {', '.join(sorted(missing))}" if missing else "its bearings contradict the leg"

    def _steer(self, flown: LegRecord, observation: Observation, now_s: float) -> bool:
        """Renew the lease with the velocity that the angles ask for; True when the stop condition holds instead."""
        flown.measured_angle_rad = _subtended(flown.leg, observation)
        flown.estimate = self.monitor.estimate(now_s)
        arrived = self.monitor.arrived(now_s)
        if not self.monitor.dwelling:
            self._angle_errors_rad.clear()
        self._angle_errors_rad.append(wrap(flown.measured_angle_rad - flown.leg.stop_angle_rad))
        if arrived:
            return True
        along_mps, across_mps = leg_velocity(flown.estimate, self.settings.limits)
        self.lease.renew(self.frame.to_site(self.monitor.course * complex(along_mps, across_mps)))
        self.monitor.commanded(now_s, along_mps, across_mps)
        self._say("")
        return False

    def _suspend(self, problem: str, now_s: float) -> None:
        """Zero velocity while the problem lasts. HoldRequiredError when it lasts too long."""
        self.lease.stop()
        self.monitor.commanded(now_s, 0.0, 0.0)
        self._say(f"{problem}: zero velocity")
        if now_s - self._usable_s >= self.settings.give_up_s:
            raise HoldRequiredError(f"{problem} (for {now_s - self._usable_s:.1f} s)")

    def _say(self, reason: str) -> None:
        """Announce a new reason, once."""
        if self.record.reason != reason:
            self.record.reason = reason
            self.announce(self.record)


def _subtended(leg: Leg, observation: Observation) -> float:
    first, second = (observation.directions_rad[name] for name in leg.stop_reference)
    return wrap(second - first)
