"""Lab 1: a service that adds two integers, and its client."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

import srvgen
from taskrpc.course.labs.checks.common import (
    ANSWERED,
    STARTED,
    answer,
    ended,
    expect_spun,
    has_client,
    remark,
    service_of,
)
from taskrpc.course.labs.lab import Check, Lab, NotMet
from taskrpc.course.labs.trial import Trial
from taskrpc.course.labs.variants import Variant

if TYPE_CHECKING:
    from srvgen.stubs.example_interfaces.srv import AddTwoInts

_TYPE: Final = "example_interfaces/srv/AddTwoInts"
_WAITS = re.compile(r"\b(wait_for_service|service_is_ready)\b")
_ABSENT = 5.0
"""Seconds until the server starts: taskrpc reports a request without a server after 2 to 3 s."""
_NAMES = (
    "add_two_ints",
    "sum_of_two",
    "plus",
    "add_up",
    "total_of_two",
    "sum_up",
    "add_numbers",
    "addition",
    "sum_service",
    "adder",
    "total",
    "calculate_sum",
    "two_to_one",
)


def _service(variant: Variant) -> str:
    # The number lets a class of 30 have few names twice.
    number = variant.number("room", 0, 99)
    return variant.choose("service", _NAMES) + (f"_{number}" if number else "")


def _values(variant: Variant) -> Mapping[str, str]:
    return {"SERVICE": _service(variant)}


async def _offers(trial: Trial) -> None:
    server = await trial.start("server.py")
    await service_of(trial, server, srvgen.load(_TYPE), f"/{_service(trial.variant)}")


async def _adds(trial: Trial) -> None:
    server = await trial.start("server.py")
    add_two_ints = srvgen.load(_TYPE)
    client = await service_of(trial, server, add_two_ints, f"/{_service(trial.variant)}")
    pairs = [(2, 3), (trial.unpredictable(100, 999), trial.unpredictable(-999, -100))]
    for a, b in pairs:
        words = f"a={a} b={b}"
        response = await answer(client, add_two_ints.Request(a=a, b=b), words)
        if response.sum != a + b:
            raise NotMet(
                f"the response to {words} to be sum={a + b}",
                f"sum={response.sum}",
                "which line of the callback sets response.sum?",
            )


async def _logs(trial: Trial) -> None:
    server = await trial.start("server.py")
    add_two_ints = srvgen.load(_TYPE)
    client = await service_of(trial, server, add_two_ints, f"/{_service(trial.variant)}")
    # So many that a program cannot write them all.
    a, b = trial.unpredictable(10**6, 2 * 10**6), trial.unpredictable(3 * 10**6, 4 * 10**6)
    await answer(client, add_two_ints.Request(a=a, b=b), f"a={a} b={b}")
    if await server.wait_for_line(rf"{a}.*{b}|{b}.*{a}", timeout=ANSWERED) is None:
        raise NotMet(
            f"the server to log a line with the numbers of the request, {a} and {b}",
            "it logged no such line",
            "self.get_logger().info(...) with an f-string of request.a and request.b",
        )


async def _prints(trial: Trial) -> None:
    # Our server responds with a number that no addition gives: a client that adds is found out.
    # No client can print all numbers that it may be.
    number = trial.unpredictable(10**6, 10**7 - 1)
    a, b = trial.unpredictable(100, 499), trial.unpredictable(500, 999)
    requests: list[AddTwoInts.Request] = []

    def respond(request: AddTwoInts.Request, response: AddTwoInts.Response) -> AddTwoInts.Response:
        requests.append(request)
        response.sum = number
        return response

    service = trial.node.create_service(srvgen.load(_TYPE), f"/{_service(trial.variant)}", respond)
    try:
        client = await trial.start("client.py", str(a), str(b))
        code = await client.finished(timeout=STARTED)
    finally:
        service.destroy()
    if code is None and not requests:
        raise NotMet(
            "the client to send its request, because a server offers the service",
            "it still runs, and sent no request",
            "which loop does not end? wait_for_service returns True if there is a server",
        )
    if code is None:
        raise NotMet(
            "the client to end after the response",
            "it sent the request, and still runs",
            "what lets rclpy run while the client waits? See spin_until_future_complete",
        )
    text = "\n".join(client.output)
    if code != 0 and "NoneType" in text:
        raise NotMet(
            "send_request to return the response",
            f"it returned None; {ended(client, code)}",
            "a future has a result once it is complete; return this result",
        )
    if not requests:
        raise NotMet(
            f"the client to send one request to {service.service_name}",
            ended(client, code),
            "compare name and type in create_client, and see call_async",
        )
    if not re.search(rf"(?<!\d){number}(?!\d)", text):
        raise NotMet(
            f"the client to print the sum of the response, here {number}",
            ended(client, code),
            "only the server adds: print response.sum, whatever it is",
        )
    if [(each.a, each.b) for each in requests] != [(a, b)]:
        raise NotMet(
            f"`client.py {a} {b}` to send one request, with a={a} b={b}",
            f"it sent {' and '.join(f'a={each.a} b={each.b}' for each in requests)}",
            "sys.argv[1] and sys.argv[2] are the numbers; call send_request once",
        )
    expect_spun(client)


async def _waits(trial: Trial) -> None:
    name = f"/{_service(trial.variant)}"
    expected = "the client to wait for its server before it sends the request"
    look = "wait_for_service returns True or False: repeat it until it is True, then send"
    # Read before the program runs, which can replace its file by something that never ends.
    # The call may be in a module beside client.py.
    files = [path for path in trial.folder.rglob("*.py") if path.is_file()]
    calls = any(_WAITS.search(path.read_text(errors="replace")) for path in files)
    client = await trial.start("client.py", "1", "2")
    await has_client(trial, client, name)
    await client.wait_for_line("ROS 2 would lose this request", timeout=_ABSENT)
    if (code := await client.finished(timeout=0.0)) is not None:
        raise NotMet(expected, f"no server ran, and {ended(client, code)}", look)

    def respond(request: AddTwoInts.Request, response: AddTwoInts.Response) -> AddTwoInts.Response:
        response.sum = 3
        return response

    service = trial.node.create_service(srvgen.load(_TYPE), name, respond)
    try:
        code = await client.finished(timeout=STARTED)
    finally:
        service.destroy()
    if said := remark(client):
        raise NotMet(expected, f"it did not wait: {said}", look)
    if not calls:
        raise NotMet(expected, "no file of the folder has a call of wait_for_service", look)
    if code is None:
        raise NotMet("the client to finish once its server has started", "it still waits", look)


LAB = Lab(
    number=1,
    title="A first service",
    minutes=20,
    goal="You can write a service and its client, and say what each line is for.",
    files=("server.py", "client.py"),
    values=_values,
    checks=(
        Check("the server offers the service", 2, _offers),
        Check("the server adds", 3, _adds, needs=("the server offers the service",)),
        Check("the server logs each request", 1, _logs, needs=("the server adds",)),
        Check("the client prints the response", 3, _prints),
        Check(
            "the client waits for its server", 1, _waits, needs=("the client prints the response",)
        ),
    ),
)
