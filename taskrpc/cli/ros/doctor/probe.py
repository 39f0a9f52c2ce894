"""Examines one address for `taskrpc doctor`: name, route, port, socket, and taskrpc itself."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import os
import socket
import stat
import sys
import threading
from collections.abc import AsyncIterator, Callable, Sequence
from functools import partial

from taskrpc.cli.ros.doctor import encryption
from taskrpc.cli.ros.doctor.checks import Finding, ok, problem
from taskrpc.cli.shared.remote import Remote
from taskrpc.errors import AuthenticationFailed, ConnectionLost, ProtocolError, TaskRpcError
from taskrpc.spi import is_unix, path_of, process_state, split_address, with_address

STEP_TIMEOUT = 4.0
"""Seconds for each step."""

_NO_RESPONSE = (
    "the server there hangs or was stopped (`taskrpc ps` on that machine shows which), or"
    " another program than taskrpc listens"
)
# The error numbers of POSIX, then those of Windows, which asyncio does not translate.
_NO_SUCH_NETWORK = frozenset({errno.ENETUNREACH, errno.ENETDOWN, 1231, 10051, 10050})
_NO_SUCH_HOST = frozenset({errno.EHOSTUNREACH, errno.EHOSTDOWN, 1232, 10065, 10064})


async def examine(remote: Remote) -> AsyncIterator[Finding]:
    """Check each step of a connection to an address; ends at the first step that fails."""
    if is_unix(remote.address):
        found = await reach_socket(remote.address, STEP_TIMEOUT)
        yield found
        if found.state != "problem":
            yield await _list_services(remote)
        return
    host, port = split_address(remote.address)
    try:
        addresses = await resolve(host, port, STEP_TIMEOUT)
    except OSError as error:
        yield problem(
            f"the name {host} is unknown: {_reason(error)}",
            "check its spelling, or use the IP address of the other machine",
        )
        return
    if addresses != [host]:
        yield ok(f"{host} is {', '.join(addresses)}")
    reached, finding = await _connect(addresses, port)
    yield finding
    if reached:
        yield await _list_services(remote)


async def resolve(host: str, port: int, timeout: float) -> list[str]:
    """Return the addresses of a host. Raises OSError, also if there is no response in time."""
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
        with contextlib.suppress(RuntimeError):  # the command has ended: the loop is closed
            loop.call_soon_threadsafe(lambda: None if answer.done() else settle())

    # The system's resolver has no timeout. A daemon thread, because asyncio would wait for a thread
    # of its own before the command can end.
    threading.Thread(target=look_up, daemon=True).start()
    try:
        async with asyncio.timeout(timeout):
            return await answer
    except TimeoutError:
        raise TimeoutError(f"no response within {timeout:g} s") from None


async def _connect(addresses: Sequence[str], port: int) -> tuple[str, Finding]:
    """Return the first address that accepts a connection ("" if none does), and the finding."""
    finding = problem("the name has no address", "check its spelling")
    for address in addresses:
        try:
            async with asyncio.timeout(STEP_TIMEOUT):
                _, writer = await asyncio.open_connection(address, port)
        except OSError as error:
            finding = no_connection(error, address, port)
        else:
            writer.close()
            return address, ok(f"a program listens at {address} port {port}")
    return "", finding


def no_connection(error: OSError, address: str, port: int) -> Finding:
    """Return why a connection to an address failed, and what to do."""
    if isinstance(error, ConnectionRefusedError):
        return problem(
            f"no program listens at {address} port {port}",
            f"start the server there with --listen HOST:{port}, where HOST is its address",
        )
    if _is_one_of(error, _NO_SUCH_NETWORK):
        return problem(
            f"this machine has no route to the network of {address}: {_reason(error)}",
            "connect to the network (Wi-Fi, cable) of the other machine",
        )
    if _is_one_of(error, _NO_SUCH_HOST):
        return problem(
            f"no machine answers at {address}: {_reason(error)}",
            "check that the machine is on and still has this address. A Wi-Fi with client isolation"
            " (guests cannot reach each other) has the same effect: use the lecturer's hotspot or a"
            " cable",
        )
    if isinstance(error, PermissionError):
        return problem(
            f"a firewall of this machine or a router forbids {address}: {_reason(error)}",
            f"allow TCP port {port} there",
        )
    # Our timeout and the system's timeout both raise TimeoutError.
    if isinstance(error, TimeoutError):
        return problem(
            f"{address} did not respond at port {port} within {STEP_TIMEOUT:g} s",
            f"a firewall there may drop connections: allow Python or TCP port {port}; if other"
            " machines cannot connect either, the Wi-Fi may have client isolation (guests cannot"
            " reach each other): use the lecturer's hotspot, or a cable",
        )
    return problem(
        f"{address} cannot be reached: {_reason(error)}", "check the network of both machines"
    )


async def _list_services(remote: Remote) -> Finding:
    address = remote.address
    try:
        listing = await remote.listing(address)
    except AuthenticationFailed as error:
        return await encryption.fault(remote, STEP_TIMEOUT) or problem(
            f"{address} is taskrpc, but: {_without(address, error)}",
            "if you joined this server with the lecturer's string, join again (the account may be"
            " revoked or expired); otherwise give its secret with --token-file or TASKRPC_TOKEN",
        )
    except (ConnectionLost, ProtocolError) as error:
        if advice := _advice(str(error)):
            return problem(with_address(address, error), advice)
        if process_state.STOPPED in str(error):
            return problem(*str(error).split("; ", 1))
        is_silent = "within" in str(error) or "did not respond" in str(error)
        advice = _NO_RESPONSE if is_silent else "another program than taskrpc listens there"
        fault = await encryption.fault(remote, STEP_TIMEOUT)
        return fault or problem(with_address(address, error), advice)
    except TaskRpcError as error:
        return problem(
            with_address(address, error),
            "check the files of the --tls options; if they are correct, read the server's log",
        )
    names = ", ".join(service.name for service in listing.services) or "no service"
    return ok(f"{address} offers {names}")


def _without(address: str, error: TaskRpcError) -> str:
    return str(error).removeprefix("the lab's server at ").removeprefix(address).lstrip(": ")


def _advice(error: str) -> str:
    if "domain" in error:
        return "set ROS_DOMAIN_ID to the server's"
    if "version" in error:
        return "install the same version of taskrpc on both machines"
    return ""


def _is_one_of(error: OSError, numbers: frozenset[int]) -> bool:
    return bool({error.errno, getattr(error, "winerror", None)} & numbers)


def _reason(error: OSError) -> str:
    return error.strerror or str(error)


_OTHERS = "only programs of the same user can call it: log in as that user, or listen at a port"


async def reach_socket(address: str, timeout: float) -> Finding:
    """Check whether a program accepts connections at a Unix socket, or why not."""
    path = path_of(address)
    if found := _wrong_socket_file(path, address):
        return found
    if sys.platform != "win32":  # on Windows `path_of` has refused the address
        try:
            async with asyncio.timeout(timeout):
                _, writer = await asyncio.open_unix_connection(path)
        except OSError as error:
            return _no_socket_connection(error, path, address, timeout)
        writer.close()
    return ok(f"a program listens at {path}")


def _wrong_socket_file(path: str, address: str) -> Finding | None:
    try:
        found = os.stat(path)
    except PermissionError:
        return problem(f"you have no access to {os.path.dirname(path)}", _OTHERS)
    except OSError as error:
        advice = f"check the path, or start the server there with --listen {address}"
        return problem(f"there is no socket at {path}: {error.strerror}", advice)
    if not stat.S_ISSOCK(found.st_mode):
        return problem(
            f"{path} is not a socket", "use the path from the --listen option of the server"
        )
    return None


def _no_socket_connection(error: OSError, path: str, address: str, timeout: float) -> Finding:
    if isinstance(error, ConnectionRefusedError):
        return problem(
            f"no program listens at {path}: the server that created it has ended",
            f"start it again with --listen {address}",
        )
    if isinstance(error, PermissionError):
        return problem(f"the socket {path} belongs to another user", _OTHERS)
    if isinstance(error, TimeoutError):
        return problem(
            f"the server at {path} accepted no connection within {timeout:g} s",
            "see its log; if it hangs, end it with `taskrpc stop`",
        )
    return problem(f"{path} cannot be reached: {error.strerror or error}", "check the path")
