"""Where the dashboard is served: host, port and certificate."""

from __future__ import annotations

import socket
import ssl
from dataclasses import dataclass
from pathlib import Path

from gcs.errors import ServiceError


@dataclass(frozen=True)
class Place:
    """Where the dashboard is served, and with which certificate."""

    host: str
    port: int
    certificate: Path | None = None
    key: Path | None = None
    insecure: bool = False

    @property
    def tls(self) -> bool:
        """Whether it is served over TLS."""
        return self.certificate is not None

    @property
    def url(self) -> str:
        """What to open in a browser."""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{'https' if self.tls else 'http'}://{host}:{self.port}/"


def place_of(text: str, certificate: Path | None = None, key: Path | None = None, *, insecure: bool = False) -> Place:
    """Return the place written HOST:PORT. ServiceError when it is none, or half a certificate is given."""
    host, _, port = text.rpartition(":")
    host = host.removeprefix("[").removesuffix("]")
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise ServiceError(f"{text!r} is no place to serve a dashboard: it takes HOST:PORT, such as 127.0.0.1:8080")
    if (certificate is None) is not (key is None):
        raise ServiceError("--certificate and --key go together: two PEM files")
    return Place(host, int(port), certificate, key, insecure)


def require_certificate(place: Place) -> None:
    """Return when the certificate can be used, or none is wanted. ServiceError when it cannot."""
    if place.certificate is None:
        return
    try:
        ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(place.certificate, place.key)
    except (OSError, ssl.SSLError) as error:
        raise ServiceError(
            f"{place.certificate} and {place.key} cannot be used: {error}. They are a PEM certificate and its key"
        ) from error


def listening(place: Place) -> socket.socket:
    """Return a socket that listens at the place. ServiceError when it cannot be had."""
    try:
        family, *_, address = socket.getaddrinfo(place.host, place.port, type=socket.SOCK_STREAM)[0]
        listener = socket.socket(family, socket.SOCK_STREAM)
        try:
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            listener.bind(address)
            listener.listen(128)
        except OSError:
            listener.close()
            raise
    except OSError as error:
        raise ServiceError(
            f"the dashboard cannot be served at {place.host}:{place.port}: {error.strerror or error}. Take another port"
        ) from error
    return listener
