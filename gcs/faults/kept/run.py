"""The records of one run: kept by the service's own recorders, and compared at its end with what was announced."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path

from drivers.bus.keys import SwarmKeys
from drivers.bus.messages import Progress, encode
from drivers.bus.session import Bus
from drivers.clock import Clock
from gcs.faults.kept.flight import KeptFlight
from gcs.faults.kept.journal import KeptJournal
from gcs.faults.kept.missing import NEVER_S, Missing
from gcs.faults.kept.series import KeptSeries
from gcs.relay.records import ReceiverRecord
from gcs.safety import PositionBoard
from gcs.traced_monitor import MonitorNote
from planner.frames import FormationFrame


class KeptRun:
    """The journal, and of a run kept `whole` also every message and the time series, in a folder of its own."""

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        bus: Bus,
        keys: SwarmKeys,
        records: Mapping[str, ReceiverRecord],
        board: PositionBoard,
        frame: FormationFrame,
        *,
        whole: bool,
    ) -> None:
        self._clock, self._bus, self._keys = clock, bus, keys
        self._killed_s = NEVER_S
        self._journal = KeptJournal(folder, clock)
        self._flight = KeptFlight(folder, clock, bus, keys) if whole else None
        self._series = KeptSeries(folder, clock, records, board, frame) if whole else None

    def announced(self, record: ReceiverRecord) -> None:
        """Tell journal and bus of a receiver's change, as the service does."""
        if self._killed_s < NEVER_S:
            return
        self._journal.announced(record)
        if self._series is not None:
            self._series.announced(record)
        progress = Progress(self._clock.unix_ns(), record.name, record.state.value, record.reason)
        self._bus.put_history(self._keys.progress, encode(progress))

    def said(self, text: str, taken: Collection[str], given_up: Collection[str]) -> None:
        """Tell the journal what concerns the relay as a whole."""
        if self._killed_s == NEVER_S:
            self._journal.said(text, taken, given_up)

    def traced(self, receiver: str, note: MonitorNote) -> None:
        """Record what a stop monitor was told or answered."""
        if self._flight is not None:
            self._flight.traced(receiver, note)

    def look(self) -> None:
        """Let the recorders look whether there is something to do."""
        if self._killed_s < NEVER_S:
            return
        if self._flight is not None:
            self._flight.look()
        if self._series is not None:
            self._series.look()

    def kill(self) -> None:
        """Keep nothing more: the service is killed now."""
        self._killed_s = self._clock.now_s()
        if self._flight is not None:
            self._flight.die()

    def close(self, missing: Missing) -> None:
        """Write what is left to be written, unless the service was killed, and tell what is missing."""
        self._journal.close(missing)
        if self._flight is not None:
            self._flight.close(missing, self._killed_s)
        if self._series is not None:
            self._series.close(missing, self._killed_s)
