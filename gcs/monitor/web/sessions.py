"""Sessions of browsers: a signed cookie that says who somebody is and until when; the server keeps nothing.

A cookie is signed with the token it was given for: it survives a restart of the server, and ends with the token.
"""

from __future__ import annotations

import hmac
import secrets
from dataclasses import dataclass
from typing import Final

from drivers.clock import Clock
from gcs.monitor.access import Role, Tokens

LASTS_S: Final = 12 * 3600
_LONGEST_COOKIE: Final = 256
_NONCE_BYTES: Final = 16


@dataclass(frozen=True)
class Session:
    """Somebody who has shown a token: what they may do, and what their page says with each command (CSRF)."""

    role: Role
    csrf: str


@dataclass(frozen=True)
class Sessions:
    """Issues cookies and reads them."""

    tokens: Tokens
    clock: Clock

    def issue(self, role: Role) -> str:
        """Return a cookie for a role that has a token."""
        token = self.tokens.of(role)
        if token is None:
            raise ValueError(f"no token is set for {role.name}")
        expires_s = self.clock.unix_ns() // 10**9 + LASTS_S
        claim = f"{role.name}.{expires_s}.{secrets.token_hex(_NONCE_BYTES)}"
        return f"{claim}.{token.sign(claim)}"

    def read(self, cookie: str) -> Session | None:
        """Return the session of a cookie, or None when it is not ours, has been changed or has run out."""
        claim, _, signature = cookie[:_LONGEST_COOKIE].rpartition(".")
        parts = claim.split(".")
        if len(parts) != 3 or parts[0] not in Role.__members__ or not (parts[1].isascii() and parts[1].isdigit()):
            return None
        token = self.tokens.of(Role[parts[0]])
        if token is None or not hmac.compare_digest(token.sign(claim).encode(), signature.encode()):
            return None
        if int(parts[1]) * 10**9 <= self.clock.unix_ns():
            return None
        return Session(Role[parts[0]], token.sign(f"csrf.{claim}"))
