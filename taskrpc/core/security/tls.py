"""TLS 1.3 for connections to other machines."""

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

from taskrpc.core.system import private_files
from taskrpc.errors import CannotListen, TaskRpcError

log = logging.getLogger("taskrpc.transport")

_Loaded = TypeVar("_Loaded")
_CERTIFICATE = "(?s)-----BEGIN CERTIFICATE-----.*?-----END CERTIFICATE-----"


class Tls(msgspec.Struct, frozen=True):
    """Certificates for a node: files in PEM format.

    A server needs `cert` and `key`. A client trusts servers whose certificates were signed by `ca`
    (by the system's authorities if it is not given), and checks that the certificate is for the
    host that it connects to. A server with `ca` requires its callers to show certificates that
    `ca` signed.
    """

    cert: str | Path | None = None
    """The certificate."""
    key: str | Path | None = None
    """The certificate's private key."""
    ca: str | Path | None = None
    """The authority whose signatures are trusted."""

    def server_context(self) -> ssl.SSLContext:
        """Return the context for a server's connections.

        Raises CannotListen without a certificate and its key.
        """
        if self.cert is None or self.key is None:
            raise CannotListen("listening with TLS needs a certificate and its key")
        context = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        _load_pair(context, self.cert, self.key)
        if self.ca is not None:
            _load(self.ca, lambda: context.load_verify_locations(str(self.ca)))
            context.verify_mode = ssl.CERT_REQUIRED
        return context

    def client_context(self) -> ssl.SSLContext:
        """Return the context for a client's connections.

        Raises TaskRpcError for a file that is missing or is not a certificate.
        """
        ca = self.ca
        if ca is None:
            context = ssl.create_default_context()
        else:
            # Pass it here: `load_verify_locations` would add it to the system's authorities.
            context = _load(ca, lambda: ssl.create_default_context(cafile=str(ca)))
        context.minimum_version = ssl.TLSVersion.TLSv1_3
        _load_own(self, context)
        return context


class ServerTls:
    """The current context of a server, whose certificate files may change while it runs."""

    def __init__(self, tls: Tls) -> None:
        self._tls = tls
        self._seen = _signatures(tls)
        """The signatures of the files that were loaded last."""
        self._digests: WeakKeyDictionary[ssl.SSLContext, bytes] = WeakKeyDictionary()
        """The digest of each context's certificate, while connections use the context."""
        self._context = tls.server_context()
        self.certificate = shown_certificate(tls)
        """The certificate that the server shows to new connections (PEM)."""
        self._note_digest()

    def context(self) -> ssl.SSLContext:
        """Return the context for a new connection; files that have changed are loaded again.

        If the new files cannot be used, the old context stays, and the log says why.
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
                self._note_digest()
                log.info("%s: a new certificate for new connections", self._tls.cert)
        return self._context

    def shown_with(self, context: ssl.SSLContext) -> bytes:
        """Return the digest of the certificate that connections of a context were shown."""
        return self._digests[context]

    def _note_digest(self) -> None:
        self._digests[self._context] = digest(ssl.PEM_cert_to_DER_cert(self.certificate))


def digest(certificate: bytes) -> bytes:
    """Return 32 bytes that identify a certificate (DER)."""
    return hashlib.sha256(certificate).digest()


def reason_of(error: ssl.SSLError) -> str:
    """Return why a TLS connection failed, in OpenSSL's words."""
    return getattr(error, "verify_message", "") or error.reason or str(error)


def common_name(certificate: Any) -> str:
    """Return the common name in a certificate, as `getpeercert` returns it; "" for none."""
    for part in certificate.get("subject", ()):
        for key, value in part:
            if key == "commonName":
                return str(value)
    return ""


def shown_certificate(tls: Tls | None) -> str:
    """Return the certificate that a server with these settings shows (PEM), "" if it has none.

    Its file may also contain the authorities' certificates and the key; they are left out.
    """
    if tls is None or tls.cert is None:
        return ""
    path = Path(tls.cert)
    return _load(path, lambda: first_certificate(path.read_text("ascii", errors="replace")))


def first_certificate(pem: str) -> str:
    """Return the first certificate of a text in PEM format. Raises ValueError if it has none."""
    found = re.search(_CERTIFICATE, pem)
    if found is None:
        raise ValueError("expected a certificate in PEM format")
    return found[0]


def pinned_context(certificate: str, own: Tls | None) -> ssl.SSLContext:
    """Return a client's context that accepts exactly this certificate (PEM) of the server.

    The client shows the certificate of `own`, if that has one.
    """
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    context.minimum_version = ssl.TLSVersion.TLSv1_3
    # The certificate comes from a trusted source, such as the registry of this machine. So its
    # host name and its authority need no check.
    context.check_hostname = False
    context.verify_flags |= ssl.VERIFY_X509_PARTIAL_CHAIN
    context.load_verify_locations(cadata=certificate)
    if own is not None:
        _load_own(own, context)
    return context


def _signatures(tls: Tls) -> object:
    """Return a value that changes when one of the files changes."""
    return [_signature(each) for each in (tls.cert, tls.key, tls.ca) if each is not None]


def _signature(path: str | Path) -> object:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino


def _load_own(tls: Tls, context: ssl.SSLContext) -> None:
    """Load the client's own certificate, if there is one with its key."""
    if tls.cert is not None and tls.key is not None:
        _load_pair(context, tls.cert, tls.key)


def _load_pair(context: ssl.SSLContext, cert: str | Path, key: str | Path) -> None:
    """Load a certificate and its key; log a warning if other users can read the key.

    Raises TaskRpcError.
    """

    def check_key() -> None:
        with open(key, "rb") as file:
            if problem := private_files.why_not_private(file.fileno(), key, is_key=True):
                _warn(problem)

    _load(key, check_key)
    _load(cert, lambda: context.load_cert_chain(str(cert), str(key)))


@cache  # one warning for each file, not for each connection
def _warn(problem: str) -> None:
    log.warning("other users can read this key and impersonate its owner: %s", problem)


def _load(path: str | Path, load: Callable[[], _Loaded]) -> _Loaded:
    """Return the result of `load`, which reads a file. Raises TaskRpcError if that is invalid."""
    try:
        return load()
    except (ssl.SSLError, ValueError):
        raise TaskRpcError(f"{path}: expected a certificate (and its key) in PEM format") from None
    except OSError as error:
        raise TaskRpcError(f"{path}: {error.strerror}") from None
