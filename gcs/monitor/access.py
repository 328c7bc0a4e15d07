"""Who may see a run and who may command it: two roles, each with its own secret token, and where either may be served.

A token comes from a file that only its owner can read, or from the environment; never from a command line or a URL.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import stat
from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path
from typing import Final

from drivers.bus.openness import is_loopback
from gcs.errors import ServiceError

VIEW_VARIABLE: Final = "BEARING_RELAY_VIEW_TOKEN"
COMMAND_VARIABLE: Final = "BEARING_RELAY_COMMAND_TOKEN"
SHORTEST_TOKEN: Final = 16
_LARGEST_FILE: Final = 4096
_MAKE_ONE: Final = "make one with `openssl rand -base64 24`"


class Role(IntEnum):
    """What somebody may do; a higher one includes the lower ones."""

    NOBODY = 0
    VIEW = 1
    COMMAND = 2


class Token:
    """A secret that can be compared but not read: no text, error or log shows it."""

    __slots__ = ("__digest",)

    def __init__(self, secret: str) -> None:
        if len(secret) < SHORTEST_TOKEN:
            raise ServiceError(f"a token has at least {SHORTEST_TOKEN} characters: {_MAKE_ONE}")
        self.__digest = _digest(secret)

    def is_(self, presented: str) -> bool:
        """Return whether this is the token, in a time that does not tell how much of it is right."""
        return hmac.compare_digest(self.__digest, _digest(presented))

    def sign(self, text: str) -> str:
        """Return what only a holder of this token can have said of a text, hexadecimal."""
        return hmac.new(self.__digest, text.encode(), hashlib.sha256).hexdigest()

    def __repr__(self) -> str:
        return "Token(not shown)"


@dataclass(frozen=True)
class Tokens:
    """The tokens of a screen. Without one for viewing all may see; without one for commanding nobody may command."""

    view: Token | None = None
    command: Token | None = None

    def of(self, role: Role) -> Token | None:
        """Return the token of a role."""
        return {Role.VIEW: self.view, Role.COMMAND: self.command}.get(role)

    def role_of(self, presented: str) -> Role:
        """Return what the holder of a token may do, every token being looked at whatever the first says."""
        commands = self.command is not None and self.command.is_(presented)
        views = self.view is not None and self.view.is_(presented)
        return Role.COMMAND if commands else Role.VIEW if views else Role.NOBODY

    @property
    def open_role(self) -> Role:
        """What somebody without a token may do."""
        return Role.VIEW if self.view is None else Role.NOBODY


def read_tokens(
    view_file: Path | None, command_file: Path | None, environment: Mapping[str, str] = os.environ
) -> Tokens:
    """Return the tokens of the files given, else of the environment. ServiceError when one is no good."""
    view = _secret(view_file, VIEW_VARIABLE, environment)
    command = _secret(command_file, COMMAND_VARIABLE, environment)
    if view is not None and view == command:
        raise ServiceError(f"the tokens for viewing and for commanding are the same: {_MAKE_ONE} for each")
    return Tokens(None if view is None else Token(view), None if command is None else Token(command))


def require_guarded(host: str, tokens: Tokens, *, tls: bool, insecure: bool) -> None:
    """Return when a screen may be served at `host`. ServiceError: off loopback it needs TLS and a token for viewing."""
    if is_loopback(host):
        return
    if not tls and not insecure:
        raise ServiceError(
            f"{host} is not loopback: what is served there, tokens too, can be read and changed on the way. Give "
            "--certificate and --key, or --insecure when nobody else is on that network, or tunnel to loopback by ssh"
        )
    if tokens.view is None:
        raise ServiceError(
            f"{host} is not loopback: set a token for viewing with --view-token-file or {VIEW_VARIABLE}; {_MAKE_ONE}"
        )


def _digest(secret: str) -> bytes:
    return hashlib.sha256(secret.encode()).digest()


def _secret(path: Path | None, variable: str, environment: Mapping[str, str]) -> str | None:
    where = variable if path is None else f"token file {path}"
    text = environment.get(variable) if path is None else _read_private(path)
    if text is None:
        return None
    secret = text.strip()
    if len(secret) < SHORTEST_TOKEN or not secret.isascii() or not secret.isprintable():
        raise ServiceError(f"{where} has to hold one line of at least {SHORTEST_TOKEN} ASCII characters: {_MAKE_ONE}")
    return secret


def _read_private(path: Path) -> str:
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # a pipe must not make us wait
    except OSError as error:
        raise ServiceError(f"token file {path} cannot be read: {error.strerror}") from None
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise ServiceError(f"token file {path} is no regular file")
        if status.st_mode & 0o077:
            raise ServiceError(
                f"token file {path} is open to others (mode {stat.S_IMODE(status.st_mode):04o}): chmod 600 it"
            )
        return os.read(descriptor, _LARGEST_FILE).decode("ascii", errors="replace")
    finally:
        os.close(descriptor)
