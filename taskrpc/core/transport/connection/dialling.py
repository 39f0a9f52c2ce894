"""The connections on which a process calls: one for each address, made at the first call."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Callable

from taskrpc.core.security.roles import account_of
from taskrpc.core.security.tls import reason_of
from taskrpc.core.system import os_errors, process_state
from taskrpc.core.transport.connection.client_side import HANDSHAKE_LOST, CallingConnection
from taskrpc.core.transport.network import Address, Network
from taskrpc.errors import AuthenticationFailed, ConnectionLost, TaskRpcError

ASK_FOR_STRING = "the account was revoked or has expired: ask for a new join string"

READY_TIMEOUT = 4.0
"""Seconds for dialling and the handshake together."""


class Dialler:
    """Dials each address once for all its callers; `make` builds a connection's protocol."""

    def __init__(
        self,
        network: Network,
        make: Callable[[Address], CallingConnection],
        *,
        closed: bool = False,
    ) -> None:
        self.connections: dict[CallingConnection, None] = {}
        """All open connections, including those that take no new calls."""
        self._network = network
        self._make = make
        """Makes the protocol of a connection to this address."""
        self._newest: dict[str, CallingConnection] = {}
        """By address: the connection for new calls."""
        self._dialling: dict[str, asyncio.Task[CallingConnection]] = {}
        """By address: the task that connects."""
        self._closed = closed

    async def connection(self, address: Address, deadline: float | None) -> CallingConnection:
        """Return a usable connection to a process; make one if there is none.

        Raises ConnectionLost if no process answers there, or the error with which it refused.
        """
        known = self._newest.get(address.text)
        if known is not None and known.is_usable:
            return known
        if self._closed:
            raise _destroyed()
        if known is not None:
            known.retire()
        task = self._dialling.get(address.text) or self._begin(address)
        loop = asyncio.get_running_loop()
        left = None if deadline is None else max(0.0, deadline - loop.time())
        # Not `wait_for`: the timeout of one caller must not cancel the task for the others.
        done, _ = await asyncio.wait((task,), timeout=left)
        if not done:
            raise ConnectionLost(f"{address.text} did not respond in time", not_executed=True)
        if task.cancelled():
            raise _destroyed()
        return task.result()

    def ended(self, connection: CallingConnection) -> None:
        """Remove a connection that is gone."""
        self.connections.pop(connection, None)
        for address, each in list(self._newest.items()):
            if each is connection:
                del self._newest[address]

    async def close(self) -> None:
        """Dial no more and begin to close every connection."""
        self._closed = True
        tasks = list(self._dialling.values())
        for task in tasks:
            task.cancel()
        if tasks:
            await asyncio.wait(tasks)
        for connection in list(self.connections):
            connection.close()

    def _begin(self, address: Address) -> asyncio.Task[CallingConnection]:
        task = asyncio.get_running_loop().create_task(self._dial(address))
        self._dialling[address.text] = task
        task.add_done_callback(lambda done: self._dialled(address.text, done))
        return task

    def _dialled(self, address: str, task: asyncio.Task[CallingConnection]) -> None:
        del self._dialling[address]
        if not task.cancelled():
            task.exception()  # otherwise asyncio reports it as never retrieved

    async def _dial(self, address: Address) -> CallingConnection:
        while True:
            try:
                return await self._attempt(address)
            except AuthenticationFailed:
                # The program may have started or restarted since it was searched for. Each start
                # of a program without a given secret has another one.
                found = self._found_again(address)
                if found is None or found.token == address.token:
                    raise
                address = found

    def _found_again(self, address: Address) -> Address | None:
        """The address of the program that is listed for this address now; None if none was listed.

        Raises ConnectionLost if one was listed, but has ended.
        """
        network = self._network
        listed = [network.address_of(entry) for entry in network.entries() if entry.address]
        known = (each for each in [*network.peers(), *listed] if each.text == address.text)
        found = next(known, None)
        if address.pid and (found is None or not found.pid):
            raise _unreached(address, "its program has ended; another program answers there")
        return found

    async def _attempt(self, address: Address) -> CallingConnection:
        connection, is_plain = self._make(address), False
        try:
            async with asyncio.timeout(READY_TIMEOUT):
                await self._network.dial(address, lambda: connection)
                is_plain = _is_plain(connection)
                await connection.ready
            if connection.why_closed is not None:  # by the frames that followed the handshake
                raise connection.why_closed
        except TaskRpcError as error:
            raise _explained(address, error, is_plain=is_plain) from None
        except TimeoutError:
            raise _unreached(address, "it did not respond") from None
        except ssl.SSLError as error:
            raise _unreached(address, f"no TLS connection: {reason_of(error)}") from None
        except OSError as error:
            raise _unreached(address, os_errors.reason_of(error)) from None
        except UnicodeError:
            raise _unreached(address, "not a valid host name") from None
        else:
            self._newest[address.text] = connection
            return connection
        finally:
            if not connection.is_open:
                connection.abort(ConnectionLost(f"the connection to {address.text} failed"))


def with_address(address: str, error: TaskRpcError) -> str:
    """An error's text, with the address in front of it unless the text names the address itself."""
    text = str(error)
    return text if address in text else f"{address}: {text}"


def why_silent(address: Address) -> str:
    """Why a process of this machine does not answer, "" if the reason is unknown."""
    if not address.pid or not process_state.is_stopped(address.pid):
        return ""
    return (
        f"{address.script} (pid {address.pid}) {process_state.STOPPED}; `fg` in its terminal or"
        f" `kill -CONT {address.pid}` continues it, `taskrpc stop {address.pid}` ends it"
    )


def _explained(address: Address, error: TaskRpcError, *, is_plain: bool) -> TaskRpcError:
    """The error of a failed handshake, with what to do."""
    if isinstance(error, AuthenticationFailed):
        # Only a lab's token certainly begins with an account's name; any other is secret.
        if address.domain is None:
            return AuthenticationFailed(with_address(address.text, error))
        account = account_of(address.token)
        problem = f"the lab's server at {address.text} refuses the account {account}: {error}"
        refusal = AuthenticationFailed(problem)
        refusal.add_note(ASK_FOR_STRING)
        return refusal
    if not isinstance(error, ConnectionLost):
        return error
    reason = str(error)
    if is_plain and not address.pid and reason == HANDSHAKE_LOST:
        reason += (
            "; if the server requires TLS, join its lab (taskrpc join) or give its certificate"
            " (--tls-ca, in a program tls=taskrpc.Tls(ca=...))"
        )
    return _unreached(address, reason)


def _unreached(address: Address, reason: str) -> ConnectionLost:
    """The error for a process that could not be reached; no call was sent to it."""
    problem = why_silent(address) or f"{address.text}: {reason}"
    if address.domain is not None:
        problem = (
            f"the lab's server at {problem}; is it on, and is this computer in its network?"
            " `taskrpc doctor` tests the connection, `taskrpc join --leave` forgets the lab"
        )
    return ConnectionLost(problem, not_executed=True)


def _is_plain(connection: CallingConnection) -> bool:
    transport = connection.transport
    return transport is not None and transport.get_extra_info("ssl_object") is None


def _destroyed() -> ConnectionLost:
    return ConnectionLost("the node was destroyed", not_executed=True)
