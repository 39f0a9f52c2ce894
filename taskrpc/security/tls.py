"""TLS 1.3 for connections that leave this machine."""

from __future__ import annotations

import hashlib
import logging
import os
import re
import ssl
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, TypeVar
from weakref import WeakKeyDictionary

import msgspec

from taskrpc import platform
from taskrpc.errors import CannotListen, TaskRpcError

log = logging.getLogger("taskrpc.transport")

_Loaded = TypeVar("_Loaded")
_CERTIFICATE = "(?s)-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----"


class Tls(msgspec.Struct, frozen=True):
    """Certificates for a node: files in PEM format.

    A node that takes calls needs `cert` and `key`. A node that calls trusts servers whose
    certificates `ca` signed (the system's authorities where it is not given), and checks that the
    certificate is for the host that it dialled. A node that takes calls and has `ca` wants its
    callers to show certificates signed by it.
    """

    cert: str | Path | None = None
    key: str | Path | None = None
    ca: str | Path | None = None

    def server_context(self) -> ssl.SSLContext:
        """How to accept connections. Raises CannotListen without a certificate and its key."""
        if self.cert is None or self.key is None:
            raise CannotListen("listening with TLS needs a certificate and its key")
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        _load_pair(context, self.cert, self.key)
        if self.ca is not None:
            _reading(self.ca, lambda: context.load_verify_locations(str(self.ca)))
            context.verify_mode = ssl.CERT_REQUIRED
        return context

    def client_context(self) -> ssl.SSLContext:
        """How to connect. Raises TaskRpcError for a file that is missing or is no certificate."""
        ca = self.ca
        if ca is None:
            context = ssl.create_default_context()
        else:
            # Loaded afterwards, it would be trusted beside all the system's authorities.
            context = _reading(ca, lambda: ssl.create_default_context(cafile=str(ca)))
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        _show(self, context)
        return context


class ServerTls:
    """How a server accepts connections now: its files may change while it runs."""

    def __init__(self, tls: Tls) -> None:
        self._tls = tls
        self._seen = _signatures(tls)
        self._shown: WeakKeyDictionary[ssl.SSLContext, bytes] = WeakKeyDictionary()
        self._context = tls.server_context()
        self.certificate = shown_certificate(tls)
        """What callers are shown (PEM)."""
        self._note()

    def context(self) -> ssl.SSLContext:
        """The context for a new connection, made afresh where a file has changed.

        Files that cannot be used leave everything as it was, and a line in the log.
        """
        seen = _signatures(self._tls)
        if seen != self._seen:
            self._seen = seen
            try:
                context, certificate = self._tls.server_context(), shown_certificate(self._tls)
            except TaskRpcError as error:
                log.error("the certificate stays as it was: %s", error)
            else:
                self._context, self.certificate = context, certificate
                self._note()
                log.info("%s: a new certificate for new connections", self._tls.cert)
        return self._context

    def shown_with(self, context: ssl.SSLContext) -> bytes:
        """The digest of the certificate that a connection was shown which was made with this."""
        return self._shown[context]

    def _note(self) -> None:
        self._shown[self._context] = digest(ssl.PEM_cert_to_DER_cert(self.certificate))


def digest(certificate: bytes) -> bytes:
    """What tells a certificate (DER) from all others."""
    return hashlib.sha256(certificate).digest()


def reason_of(error: ssl.SSLError) -> str:
    """What was wrong with a TLS connection, in OpenSSL's words."""
    return getattr(error, "verify_message", "") or error.reason or str(error)


def common_name(certificate: Any) -> str:
    """Whom a certificate names, as Python's ssl tells its contents; "" where nobody."""
    for part in certificate.get("subject", ()):
        for key, value in part:
            if key == "commonName":
                return str(value)
    return ""


def shown_certificate(tls: Tls | None) -> str:
    """The certificate that a server with these settings shows (PEM), "" where it has none.

    That one only: its file may have its authorities' too, and its key.
    """
    if tls is None or tls.cert is None:
        return ""
    path = Path(tls.cert)
    return _reading(path, lambda: first_certificate(path.read_text("ascii", errors="replace")))


def first_certificate(pem: str) -> str:
    """The first certificate of a text in PEM format. Raises ValueError where there is none."""
    found = re.search(_CERTIFICATE, pem)
    if found is None:
        raise ValueError("expected a certificate in PEM format")
    return found[0]


def pinned_context(certificate: str, own: Tls | None) -> ssl.SSLContext:
    """How to connect to a server whose very certificate is known: that one, and no other.

    `own` is shown to the server where it has a certificate.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    # The registry vouches for the certificate itself: whom it names, and who signed it, is nothing
    # to a program on the same machine.
    context.check_hostname = False
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    context.load_verify_locations(cadata=certificate)
    if own is not None:
        _show(own, context)
    return context


def _signatures(tls: Tls) -> object:
    """A value that changes when any of the files does."""
    return [_signature(each) for each in (tls.cert, tls.key, tls.ca) if each is not None]


def _signature(path: str | Path) -> object:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino


def _show(tls: Tls, context: ssl.SSLContext) -> None:
    """Let a connection show the certificate, where there is one with its key."""
    if tls.cert is not None and tls.key is not None:
        _load_pair(context, tls.cert, tls.key)


def _load_pair(context: ssl.SSLContext, cert: str | Path, key: str | Path) -> None:
    """Load a certificate and its key. Raises TaskRpcError; warns of a key that others can read."""

    def look() -> None:
        with open(key, "rb") as file:
            if problem := platform.why_not_private(file.fileno(), key, is_key=True):
                _warn(problem)

    _reading(key, look)
    _reading(cert, lambda: context.load_cert_chain(str(cert), str(key)))


@cache  # once a file, however many connections there are
def _warn(problem: str) -> None:
    log.warning("whoever has this key can pass for its owner: %s", problem)


def _reading(path: str | Path, load: Callable[[], _Loaded]) -> _Loaded:
    try:
        return load()
    except (ssl.SSLError, ValueError):
        raise TaskRpcError(f"{path}: expected a certificate (and its key) in PEM format") from None
    except OSError as error:
        raise TaskRpcError(f"{path}: {error.strerror}") from None
