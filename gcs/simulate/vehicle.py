"""An embedded copter flown without its messages: the dynamics of the real process behind a lease like the real one."""

from __future__ import annotations

from typing import Final

from drivers.clock import Clock
from drivers.mavlink.setpoints import ZERO_REPEATED_S, StreamLimits, StreamState
from drivers.simulation.dynamics import Dynamics
from drivers.simulation.flight import Flight, Order
from drivers.simulation.goals import Climb, Goal, Velocity
from drivers.simulation.modes import Mode
from drivers.simulation.parameters import Parameters
from drivers.simulation.weather import CALM, SimulatedWeather, copter_parameters

_REACHED: Final = 0.95
_SETTLES_S: Final = 5.0
_CLIMB_S_PER_M: Final = 10.0
_RESTING: Final = 1e-4
"""What moves by less than this, in m, m/s and m/s2, stays where it is."""


class SimulatedVehicle:
    """A copter in guided flight, moved by velocity on a lease: no renewal, zero velocity. Site frame: north + i east.

    It is in the air when made. Time passes for it when somebody looks (`advance`) or commands.
    """

    def __init__(
        self,
        home: complex,
        altitude_m: float,
        limits: StreamLimits,
        clock: Clock,
        weather: SimulatedWeather,
        seed: int,
        heading_rad: float = 0.0,
    ) -> None:
        parameters = Parameters()
        for name, value in copter_parameters(weather).items():
            parameters.set(name, value)
        self.state = StreamState.SILENT
        self.command = 0j
        """The velocity it was told last, m/s."""
        self._home = home
        self._limits = limits
        self._clock = clock
        self._calm = weather == CALM
        self._rests_under: Order | None = None
        """What it stands still under: time passes then without steps, for most of a relay wait."""
        self._lease_until_s = self._zero_until_s = 0.0
        self._flight = Flight(parameters, lambda *_: None, heading_rad, seed=seed)
        self._take_off(altitude_m)
        self._switched_on_s = clock.now_s() - self._flight.time_s

    @property
    def place(self) -> complex:
        """Where it is, m."""
        return self._home + complex(self._dynamics.north.position_m, self._dynamics.east.position_m)

    @place.setter
    def place(self, place: complex) -> None:
        """Put it somewhere else."""
        self._home += place - self.place

    @property
    def velocity(self) -> complex:
        """Its velocity over ground, m/s."""
        return complex(self._dynamics.north.velocity_mps, self._dynamics.east.velocity_mps)

    @property
    def height_m(self) -> float:
        """Its height above the place it started from."""
        return self._dynamics.height_m

    @property
    def heading_rad(self) -> float:
        """Where its nose points, azimuth."""
        return self._dynamics.heading_rad

    def silent_for_s(self) -> float:
        """Return the time since it was last heard of, s: it is always heard."""
        return 0.0

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Fly this velocity until the lease ends."""
        self.advance()
        if self.state is StreamState.PILOT:
            return
        self.state = StreamState.LEASED
        self._lease_until_s = self._clock.now_s() + self._limits.lease_s
        self._obey(velocity_north_east_mps)

    def stop(self) -> None:
        """Fly zero velocity, then be silent."""
        self.advance()
        self._stop(self._clock.now_s())

    def take_over(self) -> None:
        """Let a pilot have it, who lets it stand."""
        self.advance()
        self.state, self.command = StreamState.PILOT, 0j
        self._flight.enter(Mode.BRAKE)

    def give_back(self) -> None:
        """Let the pilot switch it to its guided mode."""
        self.advance()
        self._flight.enter(Mode.GUIDED)

    def release(self) -> str | None:
        """Give it back to the service; return why that cannot be yet and what to do, or None."""
        if self._flight.mode is not Mode.GUIDED:
            return "switch it to its guided mode"
        if self.state is StreamState.PILOT:
            self.state = StreamState.SILENT
        return None

    def advance(self) -> None:
        """Fly on to the present; a lease that ended on the way ended then."""
        now_s = self._clock.now_s()
        if self.state is StreamState.LEASED and self._lease_until_s <= now_s:
            self._fly_to(self._lease_until_s)
            self._stop(self._lease_until_s)
        if self.state is StreamState.STOPPING and self._zero_until_s <= now_s:
            self.state = StreamState.SILENT
        self._fly_to(now_s)

    @property
    def _dynamics(self) -> Dynamics:
        return self._flight.dynamics

    def _stop(self, now_s: float) -> None:
        if self.state is StreamState.PILOT:
            return
        self.state = StreamState.STOPPING
        self._zero_until_s = now_s + ZERO_REPEATED_S
        self._obey(0j)

    def _obey(self, velocity: complex) -> None:
        self.command, flight = velocity, self._flight
        horizontal = Velocity(velocity.real, velocity.imag, flight.horizontal)
        timeout_s = flight.parameters["GUID_TIMEOUT"]
        flight.obey(Order(Goal(horizontal, Climb(0.0, flight.vertical)), flight.time_s + timeout_s))

    def _fly_to(self, time_s: float) -> None:
        flight = self._flight
        if self._rests_under is flight.order:
            self._switched_on_s = time_s - flight.time_s
            return
        flight.advance(time_s - self._switched_on_s)
        if self._calm and self._rests():
            self._rests_under = flight.order

    def _rests(self) -> bool:
        """Return whether it was told to stand, and does."""
        told, dynamics, reference = self._flight.order.goal.horizontal, self._dynamics, self._dynamics.reference
        if not isinstance(told, Velocity) or told.north_mps or told.east_mps:
            return False
        moving = (
            *(dynamics.north.velocity_mps, dynamics.east.velocity_mps, dynamics.down.velocity_mps),
            *(dynamics.north.accel_mps2, dynamics.east.accel_mps2, dynamics.down.accel_mps2),
            *(reference.v_north_mps, reference.v_east_mps, reference.v_down_mps),
            *(reference.a_north_mps2, reference.a_east_mps2, reference.a_down_mps2),
            reference.north_m - dynamics.north.position_m,
            reference.east_m - dynamics.east.position_m,
            reference.down_m - dynamics.down.position_m,
        )
        return max(map(abs, moving)) < _RESTING

    def _take_off(self, altitude_m: float) -> None:
        flight = self._flight
        flight.enter(Mode.GUIDED)
        flight.arm()
        flight.take_off(altitude_m)
        latest_s = _CLIMB_S_PER_M * altitude_m
        while self.height_m < _REACHED * altitude_m and flight.time_s < latest_s:
            flight.advance(flight.time_s + 1.0)
        flight.advance(flight.time_s + _SETTLES_S)
