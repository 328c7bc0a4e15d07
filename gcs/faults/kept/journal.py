"""The journal of a run, and what it was given."""

from __future__ import annotations

from collections.abc import Collection
from contextlib import ExitStack
from itertools import zip_longest
from pathlib import Path

from drivers.clock import Clock
from gcs.faults.kept.missing import Missing
from gcs.recording.journal import FILE, change_line, open_journal, relay_line
from gcs.recording.journal_reading import Change, Entry, Said, read_journal
from gcs.relay.records import ReceiverRecord

_Told = tuple[int, str, str, object, object]
"""When, of whom, what, and what is known besides."""


class KeptJournal:
    """Written as the service writes it: every line is handed to the disk at once, whatever becomes of the service."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._path, self._clock = folder / FILE, clock
        self._opened = ExitStack()
        self._journal = self._opened.enter_context(open_journal(self._path))
        self._given: list[_Told] = []

    def announced(self, record: ReceiverRecord) -> None:
        """Write a receiver's change."""
        now_ns = self._clock.unix_ns()
        self._given.append((now_ns, record.name, record.state.value, record.reason, record.place))
        self._journal.append(change_line(now_ns, record))

    def said(self, text: str, taken: Collection[str], given_up: Collection[str]) -> None:
        """Write what concerns the relay as a whole."""
        now_ns = self._clock.unix_ns()
        self._given.append((now_ns, "", text, frozenset(taken), frozenset(given_up)))
        self._journal.append(relay_line(now_ns, text, taken, given_up))

    def close(self, missing: Missing) -> None:
        """Read it back: every line has to be there, in order, and no other."""
        self._opened.close()
        read = map(_told, read_journal(self._path).entries)
        for given, found in zip_longest(self._given, read):
            if given != found:
                missing("" if given is None else given[1], f"{FILE}: given was {given}, found is {found}")
                return


def _told(entry: Entry) -> _Told | None:
    if isinstance(entry, Change):
        return entry.time_ns, entry.receiver, entry.state.value, entry.reason, entry.place
    if isinstance(entry, Said) and entry.known is not None:
        return entry.time_ns, "", entry.relay, entry.known.taken, entry.known.given_up
    return None
