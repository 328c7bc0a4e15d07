"""Counts what a closed router refuses by its log: zenoh counts nothing, but tells of each refusal there.

A connection whose handshake failed is warned of; access control traces what every party does, and whether it may.
Events are those of zenoh 1.10. One that is not understood is counted, too: another zenoh may say it differently.
"""

from __future__ import annotations

import re
import threading
from collections import Counter, OrderedDict
from collections.abc import Collection
from typing import Final

from drivers.bus.refusals import Refusals

_ACCESS: Final = b"zenoh::net::routing::interceptor::access_control"
_HANDSHAKES: Final = b"zenoh_link_tls::unicast"
LOG_FILTER: Final = f"{_HANDSHAKES.decode()}=warn,{_ACCESS.decode()}=trace"
"""What zenoh has to log."""

SOMEBODY: Final = "somebody"
"""A party that a refusal does not name."""
_MOST_SESSIONS: Final = 4096

_SPEAKING: Final = frozenset({b"Put", b"Delete", b"Reply", b"Declare Queryable", b"Liveliness Token"})
_ASKING: Final = frozenset({b"Query", b"Declare Subscriber", b"Liveliness Query", b"Declare Liveliness Subscriber"})
_HEAD: Final = rb"\S+ +(?P<level>[A-Z]+) +[^\n]*?(?P<thread>ThreadId\(\d+\)) (?P<source>[\w:]+): "
_EVENT: Final = re.compile(_HEAD + rb"(?P<said>.*)\n", re.DOTALL)
_NO_REFUSAL: Final = re.compile(
    _HEAD + rb"(?:Using cached result: )?[0-9a-f]+ (?:on \S+ )?"
    rb"is (?:authorized to|unauthorized to [A-Z][A-Za-z/ ]* \(egress\) on) "
)
"""What is allowed, and what somebody does not hear. A key, which anybody may choose, comes behind all this."""
_WHAT: Final = rb"is unauthorized to (?P<what>[A-Z][A-Za-z/ ]*) \(ingress\) on (?P<key>.*)"
_DENIED: Final = re.compile(rb"(?P<session>[0-9a-f]+) on (?P<subject>\S+) " + _WHAT, re.DOTALL)
_DENIED_AGAIN: Final = re.compile(rb"Using cached result: (?P<session>[0-9a-f]+) " + _WHAT, re.DOTALL)
_LOOKS_AHEAD: Final = re.compile(rb"ACL \(ingress\): caching permissions for `(?P<key>.*)` \.\.\.", re.DOTALL)
_LAST_AHEAD: Final = b"Declare Liveliness Subscriber"
_WITHOUT_RIGHTS: Final = re.compile(rb"[0-9a-f]+ did not match any configured ACL subject")
_BROKEN_OFF: Final = re.compile(rb"tls handshake eof|Timeout during TLS handshake|\(os error \d+\)")
_CERTIFICATE: Final = re.compile(rb"CertCommonName\(([^()+]*)\)")


class Tally:
    """What was refused so far, by the events of a router's log. `parties` are those that its file gives rights to.

    Events are taken by one thread; another may look at what was counted.
    """

    def __init__(self, parties: Collection[str]) -> None:
        self.not_understood = 0
        """Events that tell nothing that is known: then refusals may be missing."""
        self.begun = False
        """Whether access control has said anything: it does so when it begins."""
        self._parties = frozenset(parties)
        self._connections: Counter[str] = Counter()
        self._speaking: Counter[str] = Counter()
        self._asking: Counter[str] = Counter()
        self._sessions: OrderedDict[bytes, str] = OrderedDict()
        """Whose each of the latest sessions is."""
        self._judged: dict[bytes, tuple[bytes, bytes, bytes, set[bytes]]] = {}
        """By thread, what it denied last: whom, what, on which key, and as which subjects."""
        self._ahead: dict[bytes, bytes] = {}
        """By thread, for which key it works out beforehand what will be denied: nothing is, meanwhile."""
        self._lock = threading.Lock()

    @property
    def refusals(self) -> Refusals:
        """All of it."""
        with self._lock:
            return Refusals(**self._connections, speaking=dict(self._speaking), asking=dict(self._asking))

    def take(self, event: bytes) -> bool:
        """Take one event of the log in, whole; return whether it was one of those that the filter is for."""
        if _NO_REFUSAL.match(event) is not None:
            return True
        match = _EVENT.fullmatch(event)
        with self._lock:
            if match is None:
                self.not_understood += 1
            elif match["source"] == _HANDSHAKES:
                self._connections["broken_off" if _BROKEN_OFF.search(match["said"]) else "strangers"] += 1
            elif match["source"] == _ACCESS:
                self._take_access(match["level"], match["thread"], match["said"])
            else:
                return False
        return True

    def _take_access(self, level: bytes, thread: bytes, said: bytes) -> None:
        self.begun = True
        if (ahead := _LOOKS_AHEAD.fullmatch(said)) is not None:
            self._ahead[thread] = ahead["key"]
        elif (denied := _DENIED.fullmatch(said)) is not None:
            session, subject, what, key = denied.group("session", "subject", "what", "key")
            self._remember(session, subject)
            if not self._is_same(thread, (session, what, key), subject) and not self._is_ahead(thread, what, key):
                self._count(what, session)
        elif (denied := _DENIED_AGAIN.fullmatch(said)) is not None:
            self._count(denied["what"], denied["session"])
        elif _WITHOUT_RIGHTS.match(said) is not None:
            self._connections["without_rights"] += 1
        elif level == b"TRACE" and not said.startswith(b"ACL (egress): "):
            self.not_understood += 1

    def _is_ahead(self, thread: bytes, what: bytes, key: bytes) -> bool:
        """Return whether a thread only works out what would be denied: it does so for one key, and in one go."""
        ahead = self._ahead.get(thread) == key
        if what == _LAST_AHEAD or not ahead:
            self._ahead.pop(thread, None)
        return ahead

    def _is_same(self, thread: bytes, refusal: tuple[bytes, bytes, bytes], subject: bytes) -> bool:
        """Return whether this was just told: who comes in at several interfaces is judged as a subject at each."""
        *last, subjects = self._judged.get(thread, (b"", b"", b"", set()))
        if tuple(last) == refusal and subject not in subjects:
            subjects.add(subject)
            return True
        self._judged[thread] = (*refusal, {subject})
        return False

    def _count(self, what: bytes, session: bytes) -> None:
        party = self._sessions.get(session, SOMEBODY)
        if what in _SPEAKING:
            self._speaking[party] += 1
        elif what in _ASKING:
            self._asking[party] += 1

    def _remember(self, session: bytes, subject: bytes) -> None:
        """Note whose a session is."""
        certificate = _CERTIFICATE.search(subject)
        named = "" if certificate is None else certificate[1].decode(errors="replace")
        self._sessions[session] = named if named in self._parties else SOMEBODY
        self._sessions.move_to_end(session)
        if len(self._sessions) > _MOST_SESSIONS:
            self._sessions.popitem(last=False)
