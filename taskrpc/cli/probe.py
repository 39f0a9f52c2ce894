"""Is anyone there, and is it taskrpc: what `taskrpc doctor` finds out about one HOST:PORT."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import threading
from collections.abc import AsyncIterator, Callable, Sequence
from functools import partial

from taskrpc.cli.findings import Finding, ok, problem
from taskrpc.cli.remote import Remote
from taskrpc.errors import AuthenticationFailed, ConnectionLost, ProtocolError, TaskRpcError
from taskrpc.transport.tcp import split_place

PATIENCE = 4.0
"""Seconds for each step."""

_NOT_TASKRPC = "something else than taskrpc listens there, or it wants TLS (--tls-ca)"


async def examine(remote: Remote) -> AsyncIterator[Finding]:
    """What happens at each step on the way to the services at HOST:PORT; ends where it fails."""
    host, port = split_place(remote.place)
    try:
        addresses = await resolve(host, port, PATIENCE)
    except OSError as error:
        yield problem(
            f"the name {host} is not known: {_reason(error)}",
            "check its spelling, or give the number that the other machine shows as its address",
        )
        return
    if addresses != [host]:
        yield ok(f"{host} is {', '.join(addresses)}")
    reached, finding = await _connect(addresses, port)
    yield finding
    if reached:
        yield await _ask(remote)


async def resolve(host: str, port: int, timeout: float) -> list[str]:
    """The addresses of a host. Raises OSError, also when there is no answer in time."""
    loop = asyncio.get_running_loop()
    answer: asyncio.Future[list[str]] = loop.create_future()

    def look_up() -> None:
        settle: Callable[[], object]
        try:
            found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
            addresses = list(dict.fromkeys(str(each[4][0]) for each in found))
            settle = partial(answer.set_result, addresses)
        except OSError as error:
            settle = partial(answer.set_exception, error)
        with contextlib.suppress(RuntimeError):  # nobody waits any more: the loop is closed
            loop.call_soon_threadsafe(lambda: None if answer.done() else settle())

    # The system's resolver knows no deadline, and a loop's own threads are waited for at its end.
    threading.Thread(target=look_up, daemon=True).start()
    try:
        async with asyncio.timeout(timeout):
            return await answer
    except TimeoutError:
        raise TimeoutError(f"no answer within {timeout:g} s") from None


async def _connect(addresses: Sequence[str], port: int) -> tuple[str, Finding]:
    """The first address that takes a connection ("" if none does), and what was found."""
    failed = ""
    for address in addresses:
        try:
            async with asyncio.timeout(PATIENCE):
                _, writer = await asyncio.open_connection(address, port)
        except TimeoutError:
            failed = f"{address} did not answer at port {port} within {PATIENCE:g} s"
            advice = (
                "is the other machine on, and in the same network? A firewall there may swallow"
                f" what comes: allow Python, or TCP port {port}"
            )
        except ConnectionRefusedError:
            failed = f"nobody listens at {address} port {port}"
            advice = f"start the server there with --listen HOST:{port}, HOST being its address"
        except OSError as error:
            failed = f"{address} cannot be reached: {_reason(error)}"
            advice = "check the network of both machines"
        else:
            writer.close()
            return address, ok(f"somebody listens at {address} port {port}")
    return "", problem(failed, advice)


async def _ask(remote: Remote) -> Finding:
    place = remote.place
    try:
        listing = await remote.listing(place)
    except AuthenticationFailed as error:
        return problem(
            f"{place} is taskrpc, but: {error}",
            "give the server's secret with --token-file or TASKRPC_TOKEN",
        )
    except (ConnectionLost, ProtocolError) as error:
        domain = "domain" in str(error)
        advice = "set ROS_DOMAIN_ID to the server's" if domain else _NOT_TASKRPC
        return problem(f"{place}: {error}", advice)
    except TaskRpcError as error:
        return problem(
            f"{place}: {error}",
            "check the files given here; if they are right, see the server's log",
        )
    names = ", ".join(service.name for service in listing.services) or "no service"
    return ok(f"{place} offers {names}")


def _reason(error: OSError) -> str:
    return error.strerror or str(error)
