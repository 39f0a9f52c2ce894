"""Hidden checks of lab 1, for the lecturer: numbers that the sheet does not try."""

import asyncio

import srvgen
from taskrpc.course.labs.checks import lab1
from taskrpc.course.labs.checks.common import STARTED, answer, ended, service_of
from taskrpc.course.labs.lab import Check, NotMet

ADD_TWO_INTS = srvgen.load("example_interfaces/srv/AddTwoInts")
LARGEST = 2**63 - 1
CALLS = 30


def _name(trial):
    return f"/{lab1.LAB.values(trial.variant)['SERVICE']}"


async def _expect_sum(client, a, b):
    response = await answer(client, ADD_TWO_INTS.Request(a=a, b=b), f"a={a} b={b}")
    if response.sum != a + b:
        raise NotMet(
            f"the response to a={a} b={b} to be sum={a + b}",
            f"sum={response.sum}",
            "an int64 has up to 19 digits, and a float has about 16",
        )


async def _adds_all_numbers(trial):
    server = await trial.start("server.py")
    client = await service_of(trial, server, ADD_TWO_INTS, _name(trial))
    for a, b in [(-5, 3), (-7, -8), (0, 0), (2**60 + 1, 2**60), (LARGEST, 0), (-LARGEST, -1)]:
        await _expect_sum(client, a, b)


async def _answers_many_calls(trial):
    server = await trial.start("server.py")
    client = await service_of(trial, server, ADD_TWO_INTS, _name(trial))
    numbers = [trial.unpredictable(0, 999) for _ in range(CALLS)]
    await asyncio.gather(*(_expect_sum(client, 1000 * place, n) for place, n in enumerate(numbers)))


async def _sends_negative_numbers(trial):
    a, b = trial.unpredictable(-999, -100), trial.unpredictable(2**40, 2**41)
    requests = []

    def respond(request, response):
        requests.append((request.a, request.b))
        response.sum = 0
        return response

    trial.node.create_service(ADD_TWO_INTS, _name(trial), respond)
    client = await trial.start("client.py", str(a), str(b))
    code = await client.finished(timeout=STARTED)
    if requests != [(a, b)] or code != 0:
        happened = "it still runs" if code is None else ended(client, code)
        raise NotMet(
            f"`client.py {a} {b}` to send one request with these numbers, and to end",
            f"it sent {requests}; {happened}",
            "int() reads a sign, too; and a sum of 0 is a response like any other",
        )


CHECKS = (
    Check("the server adds large and negative numbers", 2, _adds_all_numbers),
    Check("the server answers many calls at the same time", 1, _answers_many_calls),
    Check("the client sends negative numbers, and prints a sum of 0", 1, _sends_negative_numbers),
)
