"""A site's certificates: one authority, and what it signs for vehicles, routers and people.

Keys are P-256. A certificate's common name is what access control goes by (`drivers.bus_access`);
it names the hosts that its holder may be reached at, and serves both ends of a connection.
"""

from __future__ import annotations

import datetime as dt
import ipaddress
import os
import re
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from drivers.bus_access import CA_FILE, CERTIFICATE_FILE, KEY_FILE

CA_KEY_FILE = "ca.key"
CA_DAYS = 3650
CERTIFICATE_DAYS = 825
#: A clock that is a little slow takes a new certificate all the same.
_BACKDATED = dt.timedelta(hours=1)
_HOST = re.compile(r"[A-Za-z0-9]([A-Za-z0-9._-]{0,251}[A-Za-z0-9])?")


class BadCertificate(ValueError):
    """A certificate or key file cannot be read."""


def check_host(host: str) -> None:
    """Raise `BadCertificate` where what a holder shall be reached at is no address and no name."""
    if _HOST.fullmatch(host) is None and ":" not in host:
        raise BadCertificate(f"{host!r} is neither an address nor the name of a host")


def make_authority(folder: Path, name: str, days: int = CA_DAYS) -> None:
    """Make a site's authority in a folder: ca.pem, and ca.key that only its owner can read."""
    key = ec.generate_private_key(ec.SECP256R1())
    subject = _name(name)
    certificate = (
        _builder(subject, subject, key.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs=True), critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
        .sign(key, hashes.SHA256())
    )
    folder.mkdir(parents=True, exist_ok=True)
    _write_key(folder / CA_KEY_FILE, key)
    (folder / CA_FILE).write_bytes(certificate.public_bytes(serialization.Encoding.PEM))


def issue(
    authority: Path,
    folder: Path,
    name: str,
    hosts: Sequence[str] = (),
    days: int = CERTIFICATE_DAYS,
) -> None:
    """Sign a certificate and write it with its key and the authority's certificate to a folder.

    ``authority``: folder of `make_authority`; ``hosts``: IP addresses and host names at which the
    holder is reached (a vehicle or router). Raises `BadCertificate`.
    """
    ca, ca_key = read_certificate(authority / CA_FILE), _read_key(authority / CA_KEY_FILE)
    key = ec.generate_private_key(ec.SECP256R1())
    names = [_host(host) for host in dict.fromkeys((*hosts, name, "localhost", "127.0.0.1"))]
    usage = x509.ExtendedKeyUsage(
        [ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH]
    )
    certificate = (
        _builder(_name(name), ca.subject, key.public_key(), days)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs=False), critical=True)
        .add_extension(usage, critical=False)
        .add_extension(x509.SubjectAlternativeName(names), critical=False)
        .add_extension(
            x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key()), critical=False
        )
        .sign(ca_key, hashes.SHA256())
    )
    folder.mkdir(parents=True, exist_ok=True)
    _write_key(folder / KEY_FILE, key)
    (folder / CERTIFICATE_FILE).write_bytes(certificate.public_bytes(serialization.Encoding.PEM))
    (folder / CA_FILE).write_bytes(ca.public_bytes(serialization.Encoding.PEM))


def common_name(file: Path) -> str:
    """Return whom a certificate names. Raises `BadCertificate`."""
    names = read_certificate(file).subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    if not names:
        raise BadCertificate(f"{file} names nobody")
    return str(names[0].value)


def read_certificate(file: Path) -> x509.Certificate:
    """Return a certificate of a PEM file. Raises `BadCertificate`."""
    try:
        return x509.load_pem_x509_certificate(file.read_bytes())
    except (OSError, ValueError) as error:
        raise BadCertificate(f"{file} is not a certificate that can be read: {error}") from error


def _read_key(file: Path) -> ec.EllipticCurvePrivateKey:
    try:
        key = serialization.load_pem_private_key(file.read_bytes(), password=None)
    except (OSError, ValueError, TypeError) as error:
        raise BadCertificate(f"{file} is not a key that can be read: {error}") from error
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise BadCertificate(f"{file} is not a key of bladescout")
    return key


def _name(name: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = dt.datetime.now(dt.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - _BACKDATED)
        .not_valid_after(now + dt.timedelta(days=days))
    )


def _usage(*, signs: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        key_cert_sign=signs,
        crl_sign=signs,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _write_key(file: Path, key: ec.EllipticCurvePrivateKey) -> None:
    """Write a key that nobody but its owner could read at any moment."""
    pem = key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )
    file.unlink(missing_ok=True)
    descriptor = os.open(file, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
    with os.fdopen(descriptor, "wb") as opened:
        opened.write(pem)
