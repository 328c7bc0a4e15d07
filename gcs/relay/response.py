"""How a vehicle answers velocity commands: the motion that follows from what was commanded, before any measurement."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field, replace
from typing import Final

_STEP_S: Final = 0.05
_LOOK_S: Final = 0.5
_RESTS_MPS: Final = 0.01
_LONGEST_STOP_S: Final = 10.0
_COMMANDS_KEPT: Final = 50


@dataclass(frozen=True)
class Agility:
    """How fast a vehicle follows: as an ArduCopter with its default limits does.

    Its acceleration goes towards (command - velocity) / response, within the limits of acceleration and jerk. It first
    runs on beyond the place it will hold by `overshoot_s` of the change of speed, and returns there.
    """

    delay_s: float = 0.04
    response_s: float = 0.5
    acceleration_mps2: float = 2.5
    jerk_mps3: float = 5.0
    overshoot_s: float = 0.14
    return_s: float = 2.8


@dataclass
class Response:
    """Where commands have brought a vehicle that hovered at `time_s`: m, m/s, m/s2, on any two axes.

    `place` is what it holds or would hold, `overshoot` where it is against that.
    """

    agility: Agility
    time_s: float
    place: complex = 0j
    velocity: complex = 0j
    acceleration: complex = 0j
    overshoot: complex = 0j
    _command: complex = 0j
    _waiting: deque[tuple[float, complex]] = field(default_factory=lambda: deque(maxlen=_COMMANDS_KEPT))

    @property
    def unanswered_mps(self) -> float:
        """How far its speed is from the command it answers."""
        return abs(self._command - self.velocity)

    def commanded(self, time_s: float, velocity: complex) -> None:
        """Note the velocity commanded from `time_s` on; times rise."""
        self._waiting.append((time_s + self.agility.delay_s, velocity))

    def advance(self, to_s: float) -> None:
        """Carry it on to a time."""
        while self._waiting and self._waiting[0][0] <= to_s:
            at_s, command = self._waiting.popleft()
            self._move(at_s)
            self._command = command
        self._move(to_s)

    def later(self, to_s: float) -> Response:
        """Return it carried on to a later time; this one stays."""
        ahead = replace(self, _waiting=self._waiting.copy())
        ahead.advance(to_s)
        return ahead

    def at_rest(self, now_s: float) -> complex:
        """Return the place it comes to rest at when told to stop at `now_s`."""
        ahead = self.later(now_s)
        ahead.commanded(now_s, 0j)
        while ahead.time_s < now_s + _LONGEST_STOP_S:
            ahead.advance(ahead.time_s + _LOOK_S)
            if abs(ahead.velocity) < _RESTS_MPS and abs(ahead.acceleration) < _RESTS_MPS:
                break
        return ahead.place

    def _move(self, to_s: float) -> None:
        """Integrate the motion up to a time. It is most of what a bearing costs: local names only."""
        agility, command, time_s = self.agility, self._command, self.time_s
        place, velocity, acceleration, overshoot = self.place, self.velocity, self.acceleration, self.overshoot
        while time_s < to_s:
            step_s = _STEP_S
            if to_s - time_s < _STEP_S:
                step_s, time_s = to_s - time_s, to_s
            else:
                time_s += _STEP_S
            wanted = (command - velocity) / agility.response_s
            if (size := abs(wanted)) > agility.acceleration_mps2:
                wanted *= agility.acceleration_mps2 / size
            change, largest = wanted - acceleration, agility.jerk_mps3 * step_s
            if (size := abs(change)) > largest:
                change *= largest / size
            mean = acceleration + change / 2.0
            acceleration += change
            place += (velocity + mean * step_s / 2.0) * step_s
            velocity += mean * step_s
            overshoot -= (overshoot / agility.return_s + agility.overshoot_s * mean) * step_s
        self.time_s, self.place, self.velocity = time_s, place, velocity
        self.acceleration, self.overshoot = acceleration, overshoot
