"""Joins a lab with a join string: finds the server, pins its certificate, connects."""

from __future__ import annotations

import asyncio
import ssl
import time

from taskrpc.course.classroom.authority import fingerprint
from taskrpc.course.classroom.invitation import Invitation
from taskrpc.errors import AuthenticationFailed, ServiceUnavailable, TaskRpcError
from taskrpc.spi import Endpoint, Lab, Listing, Resolve, TcpNetwork, split_address

TIMEOUT = 4.0
"""Seconds for each address of a join string."""


def find_lab(invitation: Invitation) -> Lab:
    """Find the lab of a join string; sends no secret to any other server.

    Raises:
        AuthenticationFailed: the string has expired, or its server shows another certificate.
        ServiceUnavailable: no server answers at any of its addresses.
    """
    expires = invitation.expires
    if 0 < expires <= time.time():
        when = time.strftime("%Y-%m-%d %H:%M", time.localtime(expires))
        raise AuthenticationFailed(f"the join string expired at {when}: ask for a new one")
    address, certificate = _shown(invitation)
    return Lab(
        address=address,
        token=invitation.token,
        certificate=certificate,
        domain=invitation.domain,
        namespace=invitation.namespace,
        expires=expires,
    )


async def visit(lab: Lab) -> Listing:
    """Connect to a lab's server; returns its services.

    Raises AuthenticationFailed if the server rejects the token, and ConnectionLost if no server
    answers.
    """
    endpoint = Endpoint(TcpNetwork(domain=lab.domain, peers=[lab.address], lab=lab))
    try:
        deadline = endpoint.loop.time() + TIMEOUT
        connection = await endpoint.dialler.connection(endpoint.network.peers()[0], deadline)
        found: Listing = await connection.resolve(Resolve(""), deadline).future
        return found
    finally:
        await endpoint.release()


def visit_now(lab: Lab) -> Listing:
    """`visit`, for programs that have no event loop."""
    return asyncio.run(visit(lab))


def _shown(invitation: Invitation) -> tuple[str, str]:
    """Return the first address that shows the expected certificate, and the certificate."""
    silent: list[str] = []
    others: list[str] = []
    for address in invitation.addresses:
        try:
            certificate = ssl.get_server_certificate(split_address(address), timeout=TIMEOUT)
        except OSError as error:  # includes TLS errors and timeouts
            silent.append(f"{address}: {_reason(error)}")
            continue
        if fingerprint(certificate) == invitation.fingerprint:
            return address, certificate
        others.append(address)
    raise _impostor(others[0]) if others else _unreachable(silent)


def _impostor(address: str) -> TaskRpcError:
    return AuthenticationFailed(
        f"{address} shows another certificate than the join string says: it is another server, or"
        " the lab's server has a new one; ask for a new join string"
    )


def _unreachable(silent: list[str]) -> TaskRpcError:
    where = "; ".join(silent)
    address = silent[0].rpartition(": ")[0]
    error = ServiceUnavailable(f"the lab's server cannot be reached: {where}")
    error.add_note(f"`taskrpc doctor {address}` finds out why")
    return error


def _reason(error: OSError) -> str:
    if isinstance(error, TimeoutError):
        return f"no response within {TIMEOUT:g} s"
    if isinstance(error, ssl.SSLError):
        return "another program than a lab's server listens there"
    return error.strerror or str(error)
