"""The motion of a multicopter under ArduCopter's control: a pure model, stepped by whoever owns the time.

The goal of a flight mode leads a reference motion (`goals`), the airframe follows it (`airframe`). Together they
meet the times and distances measured on an ArduCopter 4.6 in SITL within 15 %, most within 5 %.
"""

from __future__ import annotations

from math import atan2, cos, hypot, pi, sin

from drivers.simulation.airframe import HORIZONTAL_GAINS, STEP_S, VERTICAL_GAINS, Air, Axis
from drivers.simulation.goals import HOVER, Goal, HoldNose, NoseAlongCourse, NoseTo, NoseTurning, Reference
from drivers.simulation.shaping import clamp

GRAVITY_MPS2 = 9.80665
NOSE_RATE_RADPS = pi / 3  # ATC_SLEW_YAW
COURSE_MIN_MPS = 1.0  # below it the nose does not follow the course
CONTACT_BEFORE_LANDED_S = 1.0  # LAND_DETECTOR_TRIGGER_SEC


class Dynamics:
    """Position, velocity and attitude of one copter, north-east-down from the place of switch-on.

    The ground is the plane down = 0. A landed copter rests until `lift_off`.
    """

    def __init__(self, heading_rad: float = 0.0, seed: int = 0) -> None:
        self.north = Axis(HORIZONTAL_GAINS)
        self.east = Axis(HORIZONTAL_GAINS)
        self.down = Axis(VERTICAL_GAINS)
        self.air = Air(seed)
        self.reference = Reference()
        self.heading_rad = heading_rad
        self.turn_rate_radps = 0.0
        self.landed = True
        self.impact_mps = 0.0
        self._contact_s = 0.0

    @property
    def ground_speed_mps(self) -> float:
        """Horizontal speed over ground."""
        return hypot(self.north.velocity_mps, self.east.velocity_mps)

    @property
    def height_m(self) -> float:
        """Height above the place of switch-on."""
        return -self.down.position_m

    def attitude_rad(self) -> tuple[float, float]:
        """Return (roll, pitch): the lean that makes the present acceleration."""
        ahead, right = cos(self.heading_rad), sin(self.heading_rad)
        forward = self.north.accel_mps2 * ahead + self.east.accel_mps2 * right
        sideways = self.east.accel_mps2 * ahead - self.north.accel_mps2 * right
        return atan2(sideways, GRAVITY_MPS2), -atan2(forward, GRAVITY_MPS2)

    def lift_off(self) -> None:
        """Leave the ground at the next step that asks for height."""
        self.landed = False
        self._contact_s = 0.0
        self._restart_reference()

    def step(self, goal: Goal = HOVER) -> None:
        """Advance by `STEP_S` towards a goal."""
        if self.landed:
            return
        reference = self.reference
        goal.horizontal.lead(reference, STEP_S)
        goal.vertical.lead(reference, STEP_S)
        self._turn_nose(goal)
        drag_north, drag_east = self.air.drag_mps2(self.north.velocity_mps, self.east.velocity_mps)
        self.north.follow(reference.north_m, reference.v_north_mps, reference.a_north_mps2, drag_north)
        self.east.follow(reference.east_m, reference.v_east_mps, reference.a_east_mps2, drag_east)
        self.down.follow(reference.down_m, reference.v_down_mps, reference.a_down_mps2, 0.0)
        self._meet_ground()

    def _turn_nose(self, goal: Goal) -> None:
        nose = goal.nose
        if isinstance(nose, HoldNose):
            self.turn_rate_radps = 0.0
            return
        wanted = nose.rate_radps if isinstance(nose, NoseTurning) else self._heading_error(nose) / STEP_S
        self.turn_rate_radps = clamp(wanted, -NOSE_RATE_RADPS, NOSE_RATE_RADPS)
        self.heading_rad = (self.heading_rad + self.turn_rate_radps * STEP_S) % (2.0 * pi)

    def _heading_error(self, nose: NoseTo | NoseAlongCourse) -> float:
        north, east = self.reference.v_north_mps, self.reference.v_east_mps
        if isinstance(nose, NoseTo):
            wanted = nose.heading_rad
        elif hypot(north, east) >= COURSE_MIN_MPS:
            wanted = atan2(east, north)
        else:
            return 0.0
        return (wanted - self.heading_rad + pi) % (2.0 * pi) - pi

    def _meet_ground(self) -> None:
        if self.down.position_m < 0.0:
            self._contact_s = 0.0
            return
        if self._contact_s == 0.0:
            self.impact_mps = self.down.velocity_mps
        for axis in (self.north, self.east, self.down):
            axis.rest()
        self.down.position_m = 0.0
        if self.reference.v_down_mps < 0.0:
            return
        self._restart_reference()
        self.turn_rate_radps = 0.0
        self._contact_s += STEP_S
        self.landed = self._contact_s >= CONTACT_BEFORE_LANDED_S

    def _restart_reference(self) -> None:
        self.reference = Reference(self.north.position_m, self.east.position_m, self.down.position_m)
