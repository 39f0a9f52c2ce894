"""Checks whether a connection fails because of a certificate, or because one side lacks TLS."""

from __future__ import annotations

import asyncio
import ssl

from taskrpc.cli.ros.doctor.checks import Finding, problem
from taskrpc.cli.shared.remote import Remote
from taskrpc.spi import Lab, is_unix, pinned_context, remembered_lab, split_address

# OpenSSL's numbers (x509_vfy.h).
_NOT_YET_VALID, _EXPIRED = 9, 10
_UNKNOWN_AUTHORITY = frozenset({2, 18, 19, 20, 21})
_OTHER_NAME = frozenset({62, 64})


async def fault(remote: Remote, timeout: float) -> Finding | None:
    """Return the problem with TLS at an address; None if TLS is not the problem.

    `timeout` is in seconds, for each step.
    """
    address, lab = remote.address, remembered_lab()
    if is_unix(address):
        return None
    if lab is not None and lab.address != address:
        lab = None
    shown = await _shown_certificate(address, timeout)
    wants_tls = remote.tls is not None or lab is not None
    if not shown:
        return _plain(address) if wants_tls else None
    if not wants_tls:
        return problem(
            f"{address} accepts only encrypted connections",
            "join with the lecturer's string (taskrpc join), or use --tls-ca with the certificate"
            " of the authority that signed the server's certificate",
        )
    if lab is not None and shown != lab.certificate:
        return problem(
            f"{address} has another certificate than when this laptop joined",
            "it is another server, or its certificate is new: ask the lecturer for a new string",
        )
    return await _refused(remote, lab, timeout)


def _plain(address: str) -> Finding:
    return problem(
        f"{address} accepts no encrypted connections: it is no taskrpc server, or a server without"
        " --tls-cert",
        "start the server with --tls-cert and --tls-key, or `taskrpc classroom --serve`",
    )


async def _refused(remote: Remote, lab: Lab | None, timeout: float) -> Finding | None:
    """Return why this machine rejects the server's certificate; None if it does not."""
    host, port = split_address(remote.address)
    if lab is not None:
        context = pinned_context(lab.certificate, remote.tls)
    else:
        assert remote.tls is not None
        context = remote.tls.client_context()
    try:
        async with asyncio.timeout(timeout):
            _, writer = await asyncio.open_connection(host, port, ssl=context)
    except ssl.SSLCertVerificationError as error:
        return _explained(remote.address, host, error)
    except OSError:
        return None
    writer.close()
    return None


def _explained(address: str, host: str, error: ssl.SSLCertVerificationError) -> Finding:
    code, what = error.verify_code, f"the certificate of {address}"
    if code == _EXPIRED:
        text, advice = f"{what} has expired", "make a new one, or correct the clock of this machine"
    elif code == _NOT_YET_VALID:
        text, advice = f"{what} is not valid yet", "correct the clock of this machine"
    elif code in _OTHER_NAME:
        text = f"{what} is not for {host}"
        advice = "use a name or an address that the certificate contains"
    elif code in _UNKNOWN_AUTHORITY:
        text = f"{what} was signed by an authority that this machine does not trust"
        advice = "use --tls-ca with the certificate of the authority that signed it"
    else:
        text = f"{what} is refused: {error.verify_message}"
        advice = "check that the authority of --tls-ca is the one that signed it"
    return problem(text, advice)


async def _shown_certificate(address: str, timeout: float) -> str:
    """Return a server's certificate (PEM), "" if it has no TLS. Sends no secret."""

    def look() -> str:
        return ssl.get_server_certificate(split_address(address), timeout=timeout)

    try:
        return await asyncio.to_thread(look)
    except (OSError, ValueError):
        return ""
