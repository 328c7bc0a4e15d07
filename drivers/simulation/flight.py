"""What an ArduCopter does in each flight mode, from arming to landing, in simulated time.

Every mode is a generator that yields the goal of one step after the other; entering a mode starts it anew.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import cos, hypot, inf, radians, sin

from drivers.simulation.airframe import STEP_S, Wind
from drivers.simulation.dynamics import Dynamics
from drivers.simulation.goals import (
    Climb,
    Coast,
    Goal,
    Height,
    HoldNose,
    HorizontalLimits,
    Loiter,
    NoseAlongCourse,
    NoseGoal,
    Place,
    Velocity,
    VerticalLimits,
)
from drivers.simulation.modes import ARMABLE, Mode
from drivers.simulation.parameters import Parameters
from drivers.simulation.shaping import approach_speed

SPOOL_UP_S = 2.2  # motors and throttle ramp of a take-off, so that 10 m take 9 s
BRAKE_DECEL_MPS2 = 7.5  # BRAKE_MODE_DECEL_RATE
ARRIVED_M = 0.5
FALL = Goal(Coast(), Climb(25.0, VerticalLimits(accel_mps2=9.8, jerk_mps3=100.0, climb_mps=25.0, sink_mps=25.0)))
CRITICAL, INFO = 2, 6  # MAV_SEVERITY

Say = Callable[[int, str], None]
"""Tells the stations something: MAV_SEVERITY and a text."""


@dataclass(frozen=True, slots=True)
class Order:
    """What GUIDED does until a time, s since switch-on."""

    goal: Goal
    until_s: float = inf


class Flight:
    """One copter's flight: mode, arming and motion, advanced lazily in fixed steps.

    Times are seconds since switch-on; positions are metres north-east-down from the place of switch-on.
    """

    def __init__(
        self, parameters: Parameters, say: Say, heading_rad: float = 0.0, ready_s: float = 0.0, seed: int = 0
    ) -> None:
        self.parameters = parameters
        self.dynamics = Dynamics(heading_rad, seed)
        self.mode = Mode.STABILIZE
        self.armed = False
        self.armed_s = 0.0
        self.paused = False
        self.home_m = (0.0, 0.0)
        self._say = say
        self._ready_s = ready_s
        self._steps = 0
        self._parameters_seen = -1
        self._idle_since_s = 0.0
        self._lift_off_s = inf
        self._programs: dict[Mode, Callable[[], Iterator[Goal]]] = {
            Mode.STABILIZE: self._fly_level,
            Mode.ALT_HOLD: self._fly_level,
            Mode.GUIDED: self._fly_guided,
            Mode.LOITER: self._loiter,
            Mode.RTL: self._return_home,
            Mode.LAND: self._land,
            Mode.BRAKE: self._brake,
        }
        self._refresh_parameters()
        self.order = self.hover()
        self._program = self._fly_level()

    @property
    def time_s(self) -> float:
        """Time since switch-on, s, of the present state."""
        return self._steps * STEP_S

    @property
    def ready(self) -> bool:
        """Whether the position estimate is good enough to arm."""
        return self.time_s >= self._ready_s

    @property
    def landed(self) -> bool:
        """Whether the copter rests on the ground."""
        return self.dynamics.landed

    def advance(self, to_time_s: float) -> None:
        """Fly on to a time since switch-on, s."""
        if self._parameters_seen != self.parameters.version:
            self._refresh_parameters()
        while (self._steps + 1) * STEP_S <= to_time_s + 1e-9:
            self._step()

    def place(self, north_m: float, east_m: float) -> None:
        """Stand somewhere else on the ground from the start."""
        self.dynamics.north.position_m, self.dynamics.east.position_m = north_m, east_m
        self.home_m = (north_m, east_m)

    def enter(self, mode: Mode) -> None:
        """Change the flight mode; entering the present mode again changes nothing."""
        if mode is self.mode:
            return
        self.mode = mode
        self.order = self.hover()
        self.paused = False
        self._lift_off_s = inf
        self._program = self._programs[mode]()

    def arm(self) -> str | None:
        """Start the motors, or return the reason why not."""
        if self.armed:
            return None
        if self.mode not in ARMABLE:
            return f"{self.mode.name} mode not armable"
        if complaint := self.complaint():
            return complaint
        self.armed = True
        self.home_m = (self.dynamics.north.position_m, self.dynamics.east.position_m)
        self._idle_since_s = self.time_s
        self._say(INFO, "Arming motors")
        return None

    def complaint(self) -> str | None:
        """Return what keeps it from arming in any mode."""
        return None if self.ready else "Need Position Estimate"

    def disarm(self, *, forced: bool = False) -> bool:
        """Stop the motors and return True; in the air only if forced, and then the copter falls."""
        if not self.armed:
            return True
        if not (self.landed or forced):
            return False
        self.armed = False
        self._lift_off_s = inf
        self._say(INFO, "Disarming motors")
        return True

    def take_off(self, height_m: float) -> bool:
        """Climb to a height above home, m; only in GUIDED, armed and on the ground."""
        if not (self.mode is Mode.GUIDED and self.armed and self.landed and height_m > 0.0):
            return False
        self.order = Order(Goal(self.stop, Height(-height_m, self.vertical)))
        self._lift_off_s = self.time_s + SPOOL_UP_S
        return True

    def obey(self, order: Order) -> None:
        """Let a setpoint take over GUIDED, a running take-off included; other modes and a pause ignore it."""
        if self.mode is Mode.GUIDED and not self.paused:
            self.order = order
            self._lift_off_s = inf

    def hover(self) -> Order:
        """Return the order to stop and hold."""
        return Order(Goal(self.stop, Climb(0.0, self.vertical)))

    def default_nose(self) -> NoseGoal:
        """Return what the nose does when nobody says (WP_YAW_BEHAVIOR)."""
        return NoseAlongCourse() if self.parameters["WP_YAW_BEHAVIOR"] else HoldNose()

    def _step(self) -> None:
        self._steps += 1
        time_s = self.time_s
        if time_s >= self._lift_off_s:
            self._lift_off_s = inf
            self.dynamics.lift_off()
        self.dynamics.step(next(self._program) if self.armed else FALL)
        if self.dynamics.impact_mps > 0.0:
            self._say(CRITICAL, f"SIM Hit ground at {self.dynamics.impact_mps:.1f} m/s")
            self.dynamics.impact_mps = 0.0
        if not self.armed:
            return
        self.armed_s += STEP_S
        if not self.landed or self._lift_off_s < inf:
            self._idle_since_s = time_s
        elif time_s - self._idle_since_s >= self.parameters["DISARM_DELAY"] > 0:
            self.disarm()

    def _refresh_parameters(self) -> None:
        values = self.parameters
        self._parameters_seen = values.version
        self.horizontal = HorizontalLimits(values["WPNAV_ACCEL"] / 100.0, values["PSC_JERK_XY"])
        self.vertical = VerticalLimits(
            accel_mps2=values["WPNAV_ACCEL_Z"] / 100.0,
            jerk_mps3=values["PSC_JERK_Z"],
            climb_mps=values["WPNAV_SPEED_UP"] / 100.0,
            sink_mps=values["WPNAV_SPEED_DN"] / 100.0,
        )
        self.stop = Velocity(limits=self.horizontal)
        speed_mps, from_rad = values["SIM_WIND_SPD"], radians(values["SIM_WIND_DIR"])
        self.dynamics.air.wind = Wind(-speed_mps * cos(from_rad), -speed_mps * sin(from_rad), values["SIM_WIND_TURB"])

    def _fly_level(self) -> Iterator[Goal]:
        """Without a pilot the sticks are centred: level, holding height."""
        goal = Goal(Coast(), Climb(0.0, self.vertical))
        while True:
            yield goal

    def _fly_guided(self) -> Iterator[Goal]:
        while True:
            if self.paused or self.time_s > self.order.until_s:
                self.order = self.hover()
            yield self.order.goal

    def _loiter(self) -> Iterator[Goal]:
        since_s = self.time_s
        hold_height = Climb(0.0, self.vertical)
        while True:
            yield Goal(Loiter(self.time_s - since_s), hold_height)

    def _brake(self) -> Iterator[Goal]:
        goal = Goal(Velocity(limits=HorizontalLimits(BRAKE_DECEL_MPS2, self.horizontal.jerk_mps3)), Climb())
        while True:
            yield goal

    def _return_home(self) -> Iterator[Goal]:
        height = Height(-max(self.parameters["RTL_ALT"] / 100.0, self.dynamics.height_m), self.vertical)
        while self.dynamics.height_m < -height.down_m - ARRIVED_M and not self.landed:
            yield Goal(self.stop, height)
        home = Place(*self.home_m, self.parameters["WPNAV_SPEED"] / 100.0, self.horizontal)
        while self._distance_m(home) > ARRIVED_M and not self.landed:
            yield Goal(home, height)
        land_s = self.time_s + self.parameters["RTL_LOIT_TIME"] / 1000.0
        while self.time_s < land_s and not self.landed:
            yield Goal(home, height)
        yield from self._land(home)

    def _land(self, above: Place | None = None) -> Iterator[Goal]:
        """Sink to LAND_ALT_LOW, then on at LAND_SPEED; disarm on the ground."""
        slow_mps, low_m = self.parameters["LAND_SPEED"] / 100.0, self.parameters["LAND_ALT_LOW"] / 100.0
        while not self.landed:
            fast_mps = approach_speed(self.dynamics.height_m - low_m, self.vertical.accel_mps2, self.vertical.jerk_mps3)
            sink_mps = max(slow_mps, min(fast_mps, self.vertical.sink_mps))
            yield Goal(above or self.stop, Climb(sink_mps, self.vertical))
        self.disarm()
        while True:
            yield FALL

    def _distance_m(self, place: Place) -> float:
        dynamics = self.dynamics
        return hypot(place.north_m - dynamics.north.position_m, place.east_m - dynamics.east.position_m)
