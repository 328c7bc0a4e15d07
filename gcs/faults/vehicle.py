"""An embedded copter without its messages that loses its link, falls silent, freezes, drifts or is taken over."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Final

from drivers.clock import Clock
from drivers.mavlink.setpoints import StreamLimits, StreamState
from drivers.simulation.weather import SimulatedWeather
from gcs.faults.radio import Radio
from gcs.simulate.vehicle import SimulatedVehicle

_FULL_PERCENT: Final = 100
_EMPTY_PERCENT: Final = 5
_PERIOD_S: Final = 0.1
"""Between two setpoints of a stream, and two messages of a vehicle."""


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
        self.battery_percent = _FULL_PERCENT
        self._uplink: Radio[complex] = Radio(f"{seed}/up")
        self._downlink: Radio[tuple[complex, complex]] = Radio(f"{seed}/down")
        self._heard_s = self._sent_s = clock.now_s()
        self._told: tuple[complex, complex] | None = None
        self._waiting: complex | None = None
        self.goes_on_since_s = clock.now_s()
        """Since when it has not been frozen."""
        super().__init__(home, altitude_m, limits, clock, weather, seed, heading_rad)

    def renew(self, velocity_north_east_mps: complex) -> None:
        """Fly this velocity until the lease ends; whoever watches is told that it was asked for."""
        self.advance()
        self._commanded(velocity_north_east_mps)
        super().renew(velocity_north_east_mps)

    def silent_for_s(self) -> float:
        """Return the time since it was last heard of, s."""
        silent_s = 0.0 if self._silent_since_s is None else self._clock.now_s() - self._silent_since_s
        return silent_s if self._told is None else max(silent_s, self._clock.now_s() - self._heard_s)

    @property
    def impaired(self) -> bool:
        """Whether its radio fails, or has failed."""
        return self._told is not None

    @property
    def told(self) -> tuple[complex, complex]:
        """Where it has told to be, m, and its velocity, m/s."""
        return (self.place, self.velocity) if self._told is None else self._told

    @property
    def heard(self) -> bool:
        """Whether its telemetry arrives."""
        return self._silent_since_s is None

    def fall_silent(self, *, silent: bool) -> None:
        """Send no more telemetry, or send it again."""
        self._silent_since_s = self._clock.now_s() if silent else None

    def impair(self, **shares_and_times: float) -> None:
        """Let its radio fail otherwise, either way: by words of an `Impairment`, 0 no more."""
        self.advance()
        for radio in (self._uplink, self._downlink):
            radio.impairment = replace(radio.impairment, **shares_and_times)
        if self._told is None:
            self._told, self._heard_s, self._sent_s = self.told, self._clock.now_s(), self._clock.now_s()

    def drain(self, *, drained: bool) -> None:
        """Tell of an empty battery, or of a full one."""
        self.battery_percent = _EMPTY_PERCENT if drained else _FULL_PERCENT

    def cut_link(self, *, cut: bool) -> None:
        """Get no more setpoints, or get again the one that is streamed just now."""
        self.advance()
        self.cut = cut
        if not cut and self.state in (StreamState.LEASED, StreamState.STOPPING):
            self._obey(self.command)

    def freeze(self, *, frozen: bool) -> None:
        """Stand still in time as a stopped process does, or go on: by what it was told meanwhile."""
        self.advance()
        self.fall_silent(silent=frozen)
        self.frozen, waiting, self._waiting = frozen, self._waiting, None
        self.goes_on_since_s = self._clock.now_s()
        if waiting is not None:
            self._obey(waiting)

    def reboot(self, *, down: bool) -> None:
        """Be gone, or come back in a mode that is not the guided one."""
        self.freeze(frozen=down)
        if not down:
            self.take_over()

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
        if self._told is not None:
            self._speak(now_s)

    def _obey(self, velocity: complex) -> None:
        if self.cut or self.frozen:
            self.command = velocity
            self._waiting = velocity if self.frozen and not self.cut else self._waiting
        elif self._told is None:
            super()._obey(velocity)
        else:
            self.command = velocity
            self._uplink.send(self._clock.now_s(), velocity)

    def _speak(self, now_s: float) -> None:
        """Let its stream and its telemetry go over the radio, as far as they are due, and arrive."""
        while self._sent_s + _PERIOD_S <= now_s:
            self._sent_s += _PERIOD_S
            if self.state in (StreamState.LEASED, StreamState.STOPPING) and not self.cut:
                self._uplink.send(self._sent_s, self.command)
            if self.heard:
                self._downlink.send(self._sent_s, (self.place, self.velocity))
        commanded = self.command
        for _, velocity in self._uplink.arrived(now_s):
            if not (self.cut or self.frozen or self.state is StreamState.PILOT):
                super()._obey(velocity)
        self.command = commanded
        for at_s, told in self._downlink.arrived(now_s):
            self._heard_s, self._told = at_s, told

    def _fly_to(self, time_s: float) -> None:
        if self.frozen:
            self._switched_on_s = time_s - self._flight.time_s
        else:
            super()._fly_to(time_s)
