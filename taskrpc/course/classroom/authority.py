"""The lab's authority and its server's certificate; needs the extra `tls` (cryptography)."""

from __future__ import annotations

import datetime
import hashlib
import ipaddress
import ssl
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.spi import first_certificate, private_files

if TYPE_CHECKING:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey

_AUTHORITY_DAYS = 3650  # validity of the authority's certificate
_SERVER_DAYS = 825  # validity of the server's certificate
_CLOCKS_DIFFER = datetime.timedelta(days=2)
"""A laptop whose clock is late by up to this much can still join."""


class Certificates(msgspec.Struct, frozen=True):
    """The certificate files of a lab (PEM); only this user can read the keys."""

    ca: Path
    ca_key: Path
    cert: Path
    key: Path

    @property
    def fingerprint(self) -> bytes:
        """SHA-256 of the server's certificate. Raises TaskRpcError for any other file."""
        try:
            return fingerprint(self.cert.read_text(encoding="ascii"))
        except (OSError, ValueError):
            raise TaskRpcError(f"{self.cert}: expected a certificate in PEM format") from None


def fingerprint(pem: str) -> bytes:
    """Return the SHA-256 of the first certificate in a text. Raises ValueError without one."""
    return hashlib.sha256(ssl.PEM_cert_to_DER_cert(first_certificate(pem))).digest()


def files_in(folder: Path) -> Certificates:
    """Return the paths of a lab's certificates."""
    return Certificates(
        folder / "ca.pem", folder / "ca.key", folder / "server.pem", folder / "server.key"
    )


def make_certificates(folder: Path, names: Sequence[str], now: datetime.datetime) -> Certificates:
    """Make the authority if it does not exist yet, and a new certificate for the server.

    `names` are the server's host names and addresses. Raises TaskRpcError without the extra `tls`.
    """
    _require_cryptography()
    made = files_in(folder)
    if made.ca.exists() and made.ca_key.exists():
        ca, ca_key = _read_authority(made)
    else:
        ca, ca_key = _make_authority(now)
        private_files.write_private(made.ca_key, _pem_of_key(ca_key))
        private_files.write_private(made.ca, _pem(ca))
    cert, key = _make_server(ca, ca_key, names, now)
    private_files.write_private(made.key, _pem_of_key(key))
    private_files.write_private(made.cert, _pem(cert) + _pem(ca))
    return made


def _require_cryptography() -> None:
    try:
        import cryptography  # noqa: F401 - only checks whether it is installed
    except ImportError:
        raise TaskRpcError(
            "making certificates needs the library cryptography: pip install cryptography"
        ) from None


def _make_authority(
    now: datetime.datetime,
) -> tuple[x509.Certificate, EllipticCurvePrivateKey]:
    from cryptography import x509

    key, subject = _new_key(), _called("taskrpc lab")
    usage = _usage(key_cert_sign=True, crl_sign=True)
    builder = (
        _valid(x509.CertificateBuilder(), now, _AUTHORITY_DAYS)
        .subject_name(subject)
        .issuer_name(subject)
        .public_key(key.public_key())
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(usage, critical=True)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key.public_key()), critical=False)
    )
    return _signed(builder, key), key


def _make_server(
    ca: x509.Certificate,
    ca_key: EllipticCurvePrivateKey,
    names: Sequence[str],
    now: datetime.datetime,
) -> tuple[x509.Certificate, EllipticCurvePrivateKey]:
    from cryptography import x509
    from cryptography.x509.oid import ExtendedKeyUsageOID

    key = _new_key()
    issuer = x509.AuthorityKeyIdentifier.from_issuer_public_key(ca_key.public_key())
    alternative = x509.SubjectAlternativeName([_general_name(name) for name in names])
    builder = (
        _valid(x509.CertificateBuilder(), now, _SERVER_DAYS)
        .subject_name(_called("taskrpc lab server"))
        .issuer_name(ca.subject)
        .public_key(key.public_key())
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(digital_signature=True), critical=True)
        .add_extension(x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH]), critical=False)
        .add_extension(issuer, critical=False)
        .add_extension(alternative, critical=False)
    )
    return _signed(builder, ca_key), key


def _valid(
    builder: x509.CertificateBuilder, now: datetime.datetime, days: int
) -> x509.CertificateBuilder:
    from cryptography import x509

    return (
        builder.serial_number(x509.random_serial_number())
        .not_valid_before(now - _CLOCKS_DIFFER)
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _signed(builder: x509.CertificateBuilder, key: EllipticCurvePrivateKey) -> x509.Certificate:
    from cryptography.hazmat.primitives.hashes import SHA256

    return builder.sign(key, SHA256())


def _new_key() -> EllipticCurvePrivateKey:
    from cryptography.hazmat.primitives.asymmetric import ec

    return ec.generate_private_key(ec.SECP256R1())


def _called(name: str) -> x509.Name:
    from cryptography import x509

    return x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, name)])


def _usage(**wanted: bool) -> x509.KeyUsage:
    from cryptography import x509

    all_of_them = (
        "digital_signature content_commitment key_encipherment data_encipherment key_agreement"
        " key_cert_sign crl_sign encipher_only decipher_only"
    )
    return x509.KeyUsage(**{name: wanted.get(name, False) for name in all_of_them.split()})


def _general_name(name: str) -> x509.GeneralName:
    from cryptography import x509

    try:
        return x509.IPAddress(ipaddress.ip_address(name))
    except ValueError:
        return x509.DNSName(name)


def _read_authority(made: Certificates) -> tuple[x509.Certificate, EllipticCurvePrivateKey]:
    from cryptography import x509
    from cryptography.hazmat.primitives.asymmetric.ec import EllipticCurvePrivateKey
    from cryptography.hazmat.primitives.serialization import load_pem_private_key

    try:
        ca = x509.load_pem_x509_certificate(made.ca.read_bytes())
        key = load_pem_private_key(made.ca_key.read_bytes(), None)
    except (ValueError, TypeError):
        problem = f"{made.ca}, {made.ca_key.name}: expected a certificate and its key"
        raise TaskRpcError(f"{problem}; remove both to make new ones") from None
    if not isinstance(key, EllipticCurvePrivateKey):
        raise TaskRpcError(f"{made.ca_key}: expected a key on an elliptic curve; remove it")
    return ca, key


def _pem(cert: x509.Certificate) -> bytes:
    from cryptography.hazmat.primitives.serialization import Encoding

    return cert.public_bytes(Encoding.PEM)


def _pem_of_key(key: EllipticCurvePrivateKey) -> bytes:
    from cryptography.hazmat.primitives import serialization as form

    plain = form.NoEncryption()
    return key.private_bytes(form.Encoding.PEM, form.PrivateFormat.PKCS8, plain)
