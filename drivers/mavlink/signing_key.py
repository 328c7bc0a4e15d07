"""The secret that signs a link: 32 bytes from a file or an environment variable, shown nowhere."""

from __future__ import annotations

import base64
import binascii
import hashlib
import os
import re
import stat
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from drivers.errors import LinkError

if TYPE_CHECKING:
    from hashlib import _Hash

KEY_LENGTH: Final = 32
_LARGEST_FILE: Final = 4096
_HEX: Final = re.compile(r"[0-9a-fA-F]{64}")
_WANTED: Final = "64 hexadecimal characters, or base64 of 32 bytes: make one with `openssl rand -hex 32`"


class SigningKey:
    """A key that can be used but not read: no text, error or copy of this shows it."""

    __slots__ = ("__keyed",)

    def __init__(self, secret: bytes) -> None:
        if len(secret) != KEY_LENGTH or not any(secret):
            raise LinkError(f"a signing key is {KEY_LENGTH} bytes that are not all zero: all zero switches signing off")
        self.__keyed = hashlib.sha256(secret)

    def digest(self) -> _Hash:
        """Return a SHA-256 that has taken in the key and nothing else yet."""
        return self.__keyed.copy()

    def __repr__(self) -> str:
        return "SigningKey(not shown)"

    @classmethod
    def from_file(cls, path: Path) -> SigningKey:
        """Return the key a file holds; LinkError when it holds none, or when others may read it."""
        try:
            text = _read_private(path)
        except OSError as error:
            raise LinkError(f"signing key file {_shown(path)} cannot be read: {error.strerror}") from None
        return cls(_key_bytes(text, f"signing key file {_shown(path)}"))

    @classmethod
    def from_environment(cls, name: str, environment: Mapping[str, str] = os.environ) -> SigningKey:
        """Return the key an environment variable holds; LinkError when it is not set or holds none."""
        if name not in environment:
            raise LinkError(f"environment variable {_shown(name)} is not set. It has to hold {_WANTED}")
        return cls(_key_bytes(environment[name], f"environment variable {_shown(name)}"))


def _read_private(path: Path) -> str:
    descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NONBLOCK)  # a pipe must not make us wait
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise LinkError(f"signing key file {_shown(path)} is no regular file")
        if status.st_uid != os.geteuid():
            raise LinkError(
                f"signing key file {_shown(path)} belongs to user {status.st_uid}, this runs as user {os.geteuid()}: "
                "chown it"
            )
        if status.st_mode & 0o077:
            mode = stat.S_IMODE(status.st_mode)
            raise LinkError(f"signing key file {_shown(path)} is open to others (mode {mode:04o}): chmod 600 it")
        return os.read(descriptor, _LARGEST_FILE).decode("ascii", errors="replace")
    finally:
        os.close(descriptor)


def _key_bytes(text: str, where: str) -> bytes:
    secret = _decoded(text.strip())
    if secret is None:
        raise LinkError(f"{where} does not hold a signing key, which is {_WANTED}")
    return secret


def _decoded(text: str) -> bytes | None:
    if _HEX.fullmatch(text):
        return bytes.fromhex(text)
    try:
        secret = base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError):
        return None
    return secret if len(secret) == KEY_LENGTH else None


def _shown(name: str | Path) -> str:
    """Return how to print a file's or a variable's name: not at all when somebody gave the key instead."""
    return "(a key was given where its place is wanted)" if _decoded(str(name).strip()) else str(name)
