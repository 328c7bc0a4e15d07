"""One leg of one receiver, flown on a setpoint lease that only fresh, accepted bearings renew."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol, runtime_checkable

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamState
from gcs.bearings import Observation, Observations
from gcs.errors import HoldRequiredError
from gcs.guidance import leg_velocity
from gcs.relay.locating import typical_direction
from gcs.relay.records import LegRecord, ReceiverRecord
from gcs.relay.settings import RelaySettings
from gcs.stop_monitor import StopMonitor
from planner.angles import wrap
from planner.frames import FormationFrame
from planner.plan import Leg

Announce = Callable[[ReceiverRecord], None]

_FIGURE: Final = re.compile(r"\d+\.\d+")
"""What may change in a reason that stays the same: metres, seconds."""

DISBELIEVED: Final = "its bearings agree on a place that it cannot have flown to"


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


@runtime_checkable
class FliesLegs(Protocol):
    """A lease on a vehicle that is flown elsewhere, where its link is: whole legs are asked of it."""

    async def fly(self, flight: LegFlight) -> None:
        """Fly a leg, its record kept as if it were flown here. HoldRequiredError when it must hold."""
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
    _agreed_s: dict[str, float] = field(default_factory=dict, init=False)
    """When the direction of each transmitter that the leg needs last agreed."""
    _angle_errors_rad: list[float] = field(default_factory=list, init=False)
    _objected: bool = field(default=False, init=False)

    async def fly(self) -> None:
        """Fly until the stop condition holds, then command zero velocity. HoldRequiredError when it must hold."""
        if isinstance(self.lease, FliesLegs):
            await self.lease.fly(self)
            return
        leg = self.monitor.leg
        flown = LegRecord(leg, started_s=self.clock.now_s())
        self.record.legs.append(flown)
        self._usable_s = flown.started_s
        self.monitor.begin(flown.started_s)
        self._agreed_s = dict.fromkeys((leg.guide, *leg.stop_reference), flown.started_s)
        deadline_s = flown.started_s + self.settings.longest_leg_s(leg)
        while not await self._step(flown):
            if self.clock.now_s() > deadline_s:
                raise HoldRequiredError(f"the leg took longer than {self.settings.longest_leg_s(leg):.0f} s")
        self.lease.stop()
        flown.ended_s = self.clock.now_s()
        self.monitor.commanded(flown.ended_s, 0j)
        flown.stop_angle_error_rad = typical_direction(self._angle_errors_rad) if self._angle_errors_rad else None

    async def _step(self, flown: LegRecord) -> bool:
        """Take the next observation and steer by it; True when the leg has ended."""
        observation = await self.observations.next(self.settings.gap_s)
        now_s = self.clock.now_s()
        problem = self.objection()
        if self._objected and problem is None:
            self.monitor.begin(now_s)
        self._objected = problem is not None
        if problem is None and observation is not None and self._usable(observation, now_s):
            self._usable_s = now_s
            return self._steer(flown, observation, now_s)
        problem = problem or self._overdue(observation, now_s)
        if problem is not None:
            self._suspend(problem, now_s)
        return False

    def _usable(self, observation: Observation, now_s: float) -> bool:
        """Return whether an observation is something to steer by: two directions or more agree, and none is missed."""
        agreeing = self.monitor.observe(
            observation.captured_s, observation.directions_rad, observation.sigma_rad, observation.resolution_rad
        )
        self.record.legs[-1].outliers = self.monitor.outliers
        for name in agreeing & self._agreed_s.keys():
            self._agreed_s[name] = now_s
        if self.monitor.unfollowed:
            raise HoldRequiredError("by its bearings it does not fly as told: check its link, mode and the wind")
        return len(agreeing) > 1 and not self._late(now_s)

    def _late(self, now_s: float) -> list[str]:
        """Return the transmitters the leg needs and whose directions have not agreed for too long."""
        return sorted(name for name, at_s in self._agreed_s.items() if now_s - at_s >= self.settings.gap_s)

    def _overdue(self, observation: Observation | None, now_s: float) -> str | None:
        """Return what has been wrong with the bearings for too long, in words, or None."""
        if observation is None:
            return f"no bearing report from its sensor for {self.settings.gap_s:g} s"
        late = self._late(now_s)
        if not late and now_s - self._usable_s < self.settings.gap_s:
            return None
        if self.monitor.stuck:
            return "its sensor repeats one report"
        if self.monitor.disbelieved:
            return DISBELIEVED
        unheard = [name for name in late if name not in observation.directions_rad]
        return f"it does not hear {', '.join(unheard)}" if unheard else "its bearings contradict the leg"

    def _steer(self, flown: LegRecord, observation: Observation, now_s: float) -> bool:
        """Renew the lease with the velocity that the angles ask for; True when the stop condition holds instead."""
        now = self.monitor.whereabouts(now_s)
        flown.estimate = self.monitor.estimate(now)
        arrived = self.monitor.arrived(now)
        if not self.monitor.dwelling:
            self._angle_errors_rad.clear()
        measured_rad = subtended(flown.leg, observation.directions_rad)
        if measured_rad is not None:
            flown.measured_angle_rad = measured_rad
            self._angle_errors_rad.append(wrap(measured_rad - flown.leg.stop_angle_rad))
        if arrived:
            return True
        velocity = leg_velocity(now, self.settings.limits)
        self.lease.renew(self.frame.to_site(self.monitor.course * velocity))
        self.monitor.commanded(now_s, velocity)
        self._say("")
        return False

    def _suspend(self, problem: str, now_s: float) -> None:
        """Zero velocity while the problem lasts. HoldRequiredError when it lasts too long."""
        self.lease.stop()
        self.monitor.commanded(now_s, 0j)
        self._say(f"{problem}: zero velocity")
        if now_s - self._usable_s >= self.settings.give_up_s:
            raise HoldRequiredError(f"{problem} (for {now_s - self._usable_s:.1f} s)")

    def _say(self, reason: str) -> None:
        """Announce a new reason, once; another figure in it makes no other reason."""
        if _FIGURE.sub("", self.record.reason) != _FIGURE.sub("", reason):
            self.record.reason = reason
            self.announce(self.record)


def subtended(leg: Leg, directions_rad: Mapping[str, float]) -> float | None:
    """Return the subtended angle of the leg's stop reference, or None when one of the two is not heard."""
    first, second = (directions_rad.get(name) for name in leg.stop_reference)
    return None if first is None or second is None else wrap(second - first)
