"""What the checks of several labs need: a client of the submission's service, and its messages."""

from __future__ import annotations

import asyncio
import re

import taskrpc
from taskrpc.client import Client
from taskrpc.course.labs.lab import NotMet
from taskrpc.course.labs.trial import Program, Ran, Trial
from taskrpc.message_types import RequestT, ResponseT, Srv

STARTED = 20.0
"""Seconds that a program of a submission has to offer its service."""
ANSWERED = 8.0
"""Seconds that a service of a submission has to answer: so long that taskrpc reports what hangs."""
_LOOK = 0.2  # seconds between two looks at the graph
_OFFERS_ALL = 4.0  # seconds in which a program that offers a service offers all of them
_OF_EVERY_NODE = re.compile(
    "/_|parameter|/get_type_description$|/get_logger_levels$|/set_logger_levels$"
)


async def service_of(
    trial: Trial, program: Program, srv_type: type[Srv[RequestT, ResponseT]], name: str
) -> Client[RequestT, ResponseT]:
    """Return a client of the service that a program must offer; raises NotMet if it does not."""
    client = trial.node.create_client(srv_type, name)
    waiting = asyncio.ensure_future(client.wait_for_service(timeout=STARTED))
    ending = asyncio.ensure_future(program.finished(timeout=STARTED))
    elsewhere = asyncio.ensure_future(_offers_only_others(trial))
    each = [waiting, ending, elsewhere]
    await asyncio.wait(each, return_when=asyncio.FIRST_COMPLETED)
    is_there = waiting.done() and waiting.result()
    code = ending.result() if ending.done() else None
    for task in each:
        task.cancel()
    if is_there:
        return client
    expected = f"the program to offer the service {name}"
    if code is not None:
        raise NotMet(
            expected,
            ended(program, code),
            "what does main() have to do after the node is created?"
            if code == 0
            else "start the program with `taskrpc run` and read its last lines",
        )
    if names := " and ".join(await offered_services(trial)):
        raise NotMet(expected, f"it offers {names}", "compare name and type in create_service")
    raise NotMet(
        expected,
        f"it runs, but offered no service within {STARTED:g} s",
        "does the node create its service, and does main() call rclpy.spin(node)?",
    )


async def _offers_only_others(trial: Trial) -> None:
    """Wait until the submission has offered other services than the expected one for a while."""
    for _ in range(int(STARTED / _LOOK)):
        if await offered_services(trial):
            break
        await asyncio.sleep(_LOOK)
    await asyncio.sleep(_OFFERS_ALL)


async def offered_services(trial: Trial) -> list[str]:
    """Return the services of the submission's programs, each as `/name (type)`."""
    own = trial.node.get_fully_qualified_name()
    return sorted(
        f"{service.name} ({service.type_name})"
        for entry in await trial.node.graph()
        for service in entry.services
        if service.node != own and not _OF_EVERY_NODE.search(service.name)
    )


async def has_client(trial: Trial, program: Program, name: str) -> bool:
    """Wait until a program has a client of a service, or has ended; whether it has one."""
    own = trial.node.get_fully_qualified_name()
    for _ in range(int(STARTED / _LOOK)):
        for entry in await trial.node.graph():
            if any(each.name == name and each.node != own for each in entry.clients):
                return True
        if await program.finished(timeout=_LOOK) is not None:
            return False
    return False


def remark(program: Program) -> str:
    """Return what taskrpc said of a mistake that would make ROS 2 wait in silence, or ""."""
    said = (line.partition("[taskrpc] ")[2] for line in program.output)
    return next((line for line in said if line.startswith("ROS 2 would ")), "")


def expect_spun(client: Program) -> None:
    """Raise NotMet if a client works here, and would wait for ever for its response on a robot."""
    if "thread spins" in (said := remark(client)):
        raise NotMet(
            "a client that gets its response on a robot with ROS 2, too",
            said,
            "which thread takes the response while this one waits?",
        )


async def answer(
    client: Client[RequestT, ResponseT], request: RequestT, what: str, timeout: float = ANSWERED
) -> ResponseT:
    """Return the response to a request; raises NotMet, with the reason, if there is none.

    Args:
        what: the request in words: `a=2 b=3`.
        timeout: the seconds that the service has to answer.
    """
    expected = f"a response of {client.service_name} to {what}"
    try:
        return await client.call(request, timeout=timeout)
    except taskrpc.DeadlineExceeded:
        raise NotMet(
            expected,
            f"there was none within {timeout:g} s",
            "what does the callback wait for? Print a line before and after it",
        ) from None
    except taskrpc.HandlerFailed as error:
        raise NotMet(
            expected,
            f"the callback failed: {error}",
            "start the server and call it with these values: it prints the line that failed",
        ) from None
    except taskrpc.TaskRpcError as error:
        raise NotMet(expected, f"the call failed: {error}", "does the server still run?") from None


def ended(program: Ran, code: int) -> str:
    """Return in words that a program ended, with the last line that it wrote."""
    last = next((line for line in reversed(program.output) if line.strip()), "nothing")
    return f"it ended with exit code {code} and wrote: {last.strip()}"
