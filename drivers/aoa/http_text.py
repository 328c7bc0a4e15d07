"""Fetches a small text over plain HTTP: one request, one answer, all of it within a time and a size."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from drivers.errors import SensorError

_LARGEST_HEAD_BYTES: Final = 16_384


@dataclass(frozen=True)
class HttpAddress:
    """Where a text is served."""

    host: str
    port: int
    target: str

    @classmethod
    def parse(cls, url: str) -> HttpAddress:
        """Return the address written as http://HOST:PORT/PATH. ValueError when it is not."""
        parts = urlsplit(url)
        printable = url.isascii() and url.isprintable() and " " not in url
        if parts.scheme != "http" or parts.hostname is None or not printable:
            raise ValueError(f"url: {url!r} is not written as http://HOST:PORT/PATH")
        target = (parts.path or "/") + (f"?{parts.query}" if parts.query else "")
        return cls(parts.hostname, parts.port or 80, target)

    def __str__(self) -> str:
        return f"http://{self.host}:{self.port}{self.target}"


async def fetch_text(address: HttpAddress, timeout_s: float, largest_bytes: int) -> str:
    """Return the text; bytes that are no UTF-8 come as replacement characters.

    SensorError when nobody answers within `timeout_s`, or not with a text of that size. HTTP 1.0 is asked for, so that
    the answer ends with the connection and comes in one piece.
    """
    try:
        async with asyncio.timeout(timeout_s):
            head, body = await _exchange(address, largest_bytes)
    except TimeoutError as error:
        raise SensorError(f"{address} does not answer within {timeout_s:g} s") from error
    except (OSError, ValueError, asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
        raise SensorError(f"{address} cannot be read: {error}") from error
    words = head.split(b"\r\n", 1)[0].decode("ascii", errors="replace").split(maxsplit=2)
    if len(words) < 2 or not words[0].startswith("HTTP/") or words[1] != "200":
        raise SensorError(f"{address} answers {' '.join(words)[:80]!r}, not with a text")
    return body.decode("utf-8", errors="replace")


async def _exchange(address: HttpAddress, largest_bytes: int) -> tuple[bytes, bytes]:
    reader, writer = await asyncio.open_connection(address.host, address.port, limit=_LARGEST_HEAD_BYTES)
    try:
        host = f"[{address.host}]" if ":" in address.host else address.host
        request = f"GET {address.target} HTTP/1.0\r\nHost: {host}:{address.port}\r\nConnection: close\r\n\r\n"
        writer.write(request.encode("ascii"))
        await writer.drain()
        head = await reader.readuntil(b"\r\n\r\n")
        body = bytearray()
        while len(body) <= largest_bytes and (part := await reader.read(65_536)):
            body += part
    finally:
        writer.transport.abort()  # a polite close would wait for a server that has frozen
    if len(body) > largest_bytes:
        raise ValueError(f"it serves more than {largest_bytes} bytes")
    return head, _whole(head, bytes(body))


def _whole(head: bytes, body: bytes) -> bytes:
    """Return the body, up to the length that the head promises. ValueError when less came."""
    for line in head.split(b"\r\n")[1:]:
        name, _, value = line.partition(b":")
        if name.strip().lower() == b"content-length":
            length = int(value)
            if len(body) < length:
                raise ValueError(f"{len(body)} of {length} bytes came")
            return body[: max(length, 0)]
    return body
