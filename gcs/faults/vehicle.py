"""An embedded copter without its messages that loses its link, falls silent, freezes, drifts or is taken over."""

from __future__ import annotations

from collections.abc import Callable

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamLimits, StreamState
from drivers.simulation.weather import SimulatedWeather
from gcs.simulate.vehicle import SimulatedVehicle


class FaultyVehicle(SimulatedVehicle):
    """A copter whose faults can be switched. `commanded` is told every velocity that it is asked to fly, m/s."""

    def __init__(
        self,
        home: complex,
        altitude_m: float,
        limits: StreamLimits,
        clock: Clock,
        weather: SimulatedWeather,
        seed: int,
        heading_rad: float,
        commanded: Callable[[complex], None],
    ) -> None:
        self.cut = self.frozen = self.piloted = False
        self.adrift = 0j
        """The velocity it drifts with besides, m/s."""
        self._adrift_since_s = clock.now_s()
        self._silent_since_s: float | None = None
        self._commanded = commanded
        super().__init__(home, altitude_m, limits, clock, weather, seed, heading_rad)

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Fly this velocity until the lease ends; whoever watches is told that it was asked for."""
        self.advance()
        self._commanded(velocity_north_east_mps)
        super().renew(velocity_north_east_mps)

    def silent_for_s(self) -> float:
        """Return the time since it was last heard of, s."""
        return 0.0 if self._silent_since_s is None else self._clock.now_s() - self._silent_since_s

    @property
    def heard(self) -> bool:
        """Whether its telemetry arrives."""
        return self._silent_since_s is None

    def fall_silent(self, *, silent: bool) -> None:
        """Send no more telemetry, or send it again."""
        self._silent_since_s = self._clock.now_s() if silent else None

    def cut_link(self, *, cut: bool) -> None:
        """Get no more setpoints, or get again the one that is streamed just now."""
        self.advance()
        self.cut = cut
        if not cut and self.state in (StreamState.LEASED, StreamState.STOPPING):
            self._obey(self.command)

    def freeze(self, *, frozen: bool) -> None:
        """Stand still in time as a stopped process does, or go on."""
        self.advance()
        self.fall_silent(silent=frozen)
        self.frozen = frozen

    def drift(self, velocity: complex) -> None:
        """Drift with this velocity from now on, m/s, whatever it is told."""
        self.advance()
        self.adrift, self._adrift_since_s = velocity, self._clock.now_s()

    def take_over(self) -> None:
        """Let a pilot have it, who lets it stand."""
        super().take_over()
        self.piloted = True

    def give_back(self) -> None:
        """Let the pilot switch it to its guided mode."""
        super().give_back()
        self.piloted = False

    def advance(self) -> None:
        """Fly on to the present, and drift."""
        super().advance()
        now_s = self._clock.now_s()
        self._home += self.adrift * (now_s - self._adrift_since_s)
        self._adrift_since_s = now_s

    def _obey(self, velocity: complex) -> None:
        if self.cut or self.frozen:
            self.command = velocity
        else:
            super()._obey(velocity)

    def _fly_to(self, time_s: float) -> None:
        if self.frozen:
            self._switched_on_s = time_s - self._flight.time_s
        else:
            super()._fly_to(time_s)
