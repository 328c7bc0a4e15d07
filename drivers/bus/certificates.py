"""Certificates for the parties of one bus: an authority made for it, and a key with a certificate for each party."""

from __future__ import annotations

import ipaddress
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from typing import Final

from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding, NoEncryption, PrivateFormat
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from drivers.errors import BusError

LONGEST_NAME: Final = 64
"""Characters that fit into a common name."""
_BEFORE: Final = timedelta(days=1)
"""Certificates hold from a little earlier on: clocks differ."""


@dataclass(frozen=True)
class Identity:
    """What a party proves itself with, PEM. The key is a secret and is not shown."""

    certificate: bytes
    key: bytes

    def __repr__(self) -> str:
        return "Identity(not shown)"


class Authority:
    """Vouches for the parties of one bus. Its own key lives as long as this object and is never written."""

    def __init__(self, swarm: str, now: datetime, valid_days: int) -> None:
        self._swarm = swarm
        self._from, self._until = now - _BEFORE, now + timedelta(days=valid_days)
        self._key = ec.generate_private_key(ec.SECP256R1())
        self._name = self._named("authority")
        made = (
            self._builder(self._name, self._key.public_key())
            .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
            .add_extension(_usage(certifies=True), critical=True)
            .add_extension(x509.SubjectKeyIdentifier.from_public_key(self._key.public_key()), critical=False)
            .sign(self._key, SHA256())
        )
        self.certificate: Final = made.public_bytes(Encoding.PEM)

    def identity(self, common_name: str, hosts: Sequence[str] = ()) -> Identity:
        """Return a key and a certificate for a party; one with `hosts` may be listened with at these, too.

        BusError when the name is too long.
        """
        key = ec.generate_private_key(ec.SECP256R1())
        builder = (
            self._builder(self._named(common_name), key.public_key())
            .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
            .add_extension(_usage(certifies=False), critical=True)
            .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(self._key.public_key()), critical=False)
        )
        purpose = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        builder = builder.add_extension(x509.ExtendedKeyUsage([purpose]), critical=False)
        if hosts:
            builder = builder.add_extension(
                x509.SubjectAlternativeName([_host(host) for host in hosts]), critical=False
            )
        certificate = builder.sign(self._key, SHA256()).public_bytes(Encoding.PEM)
        return Identity(certificate, key.private_bytes(Encoding.PEM, PrivateFormat.PKCS8, NoEncryption()))

    def _named(self, common_name: str) -> x509.Name:
        if len(common_name) > LONGEST_NAME:
            raise BusError(f"{common_name}: a certificate names nobody with more than {LONGEST_NAME} characters")
        return x509.Name(
            [
                x509.NameAttribute(NameOID.ORGANIZATION_NAME, self._swarm[:LONGEST_NAME]),
                x509.NameAttribute(NameOID.COMMON_NAME, common_name),
            ]
        )

    def _builder(self, name: x509.Name, key: ec.EllipticCurvePublicKey) -> x509.CertificateBuilder:
        return (
            x509.CertificateBuilder()
            .subject_name(name)
            .issuer_name(self._name)
            .public_key(key)
            .serial_number(x509.random_serial_number())
            .not_valid_before(self._from)
            .not_valid_after(self._until)
        )


def now() -> datetime:
    """Return the time by this machine's clock."""
    return datetime.now(UTC)


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _usage(*, certifies: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not certifies,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        key_cert_sign=certifies,
        crl_sign=certifies,
        encipher_only=False,
        decipher_only=False,
    )
