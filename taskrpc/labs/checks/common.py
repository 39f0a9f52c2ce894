"""What the checks of several labs need: a client of the submission's service, and its messages."""

from __future__ import annotations

import asyncio
from typing import Any

import taskrpc
from taskrpc.client import Client
from taskrpc.labs.lab import NotMet
from taskrpc.labs.trial import Program, Trial

STARTED = 10.0
"""Seconds that a program of a submission has to offer its service."""
ANSWERED = 5.0
"""Seconds that a service of a submission has to answer."""


async def service_of(
    trial: Trial, program: Program, srv_type: type[Any], name: str
) -> Client[Any, Any]:
    """Return a client of the service that a program must offer; raises NotMet if it does not."""
    client = trial.node.create_client(srv_type, name)
    waiting = asyncio.ensure_future(client.wait_for_service(timeout=STARTED))
    ending = asyncio.ensure_future(program.finished(timeout=STARTED))
    await asyncio.wait([waiting, ending], return_when=asyncio.FIRST_COMPLETED)
    code = ending.result() if ending.done() else None
    ending.cancel()
    if code is not None and not waiting.done():
        waiting.cancel()
    elif await waiting:
        return client
    expected = f"the program to offer the service {name}"
    if code is not None:
        raise NotMet(
            expected,
            ended(program, code),
            "what does main() have to do after the node is created? See the last line too",
        )
    if names := " and ".join(await offered_services(trial)):
        raise NotMet(expected, f"it offers {names}", "compare name and type in create_service")
    raise NotMet(
        expected,
        f"it runs, but offered no service within {STARTED:g} s",
        "does main() create the node and call rclpy.spin(node)?",
    )


async def offered_services(trial: Trial) -> list[str]:
    """Return the services of the submission's programs, each as `/name (type)`."""
    own = trial.node.get_fully_qualified_name()
    return sorted(
        f"{service.name} ({service.type_name})"
        for entry in await trial.node.graph()
        for service in entry.services
        if service.node != own and "/_" not in service.name and "parameter" not in service.name
    )


async def answer(client: Client[Any, Any], request: Any, what: str) -> Any:
    """Return the response to a request; raises NotMet, with the reason, if there is none.

    Args:
        what: the request in words: `a=2 b=3`.
    """
    expected = f"a response of {client.service_name} to {what}"
    try:
        return await client.call(request, timeout=ANSWERED)
    except taskrpc.DeadlineExceeded:
        raise NotMet(
            expected,
            f"there was none within {ANSWERED:g} s",
            "what does the callback wait for? Print a line before and after it",
        ) from None
    except taskrpc.HandlerFailed as error:
        raise NotMet(
            expected, f"the callback failed: {error}", "run it and read the line"
        ) from None
    except taskrpc.TaskRpcError as error:
        raise NotMet(expected, f"the call failed: {error}", "does the server still run?") from None


def ended(program: Program, code: int) -> str:
    """Return in words that a program ended, with the last line that it wrote."""
    last = next((line for line in reversed(program.output) if line.strip()), "nothing")
    return f"it ended with exit code {code} and wrote: {last.strip()}"
