"""A call from the command line, in virtual time and memory: wait, retries, output and end."""

from __future__ import annotations

import asyncio
import itertools
import json

import pytest

import srvgen
import taskrpc
from srvgen.files.search import Search
from taskrpc.cli.call import configure
from taskrpc.cli.shared.calling import Plan, perform
from taskrpc.cli.shared.command import Exit, exit_code
from taskrpc.cli.shared.parsing import Parser
from taskrpc.cli.shared.remote import Remote
from taskrpc.errors import (
    Code,
    DeadlineExceeded,
    HandlerFailed,
    InvalidName,
    InvalidRequest,
    ServiceUnavailable,
    TypeMismatch,
)

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
BASIC = srvgen.load("test_msgs/srv/BasicTypes")

ANSWER = """\
requester: making request: example_interfaces.srv.AddTwoInts_Request(a=2, b=3)

response:
example_interfaces.srv.AddTwoInts_Response(sum=5)

"""


def add(request, response):
    response.sum = request.a + request.b
    return response


async def server(callback=add, *, name="add_two_ints", type_=ADD, after=0.0):
    """Serve from `after` seconds on until cancelled."""
    await asyncio.sleep(after)
    async with taskrpc.Node("server", transport="memory") as node:
        node.create_service(type_, name, callback)
        await asyncio.Event().wait()


@pytest.fixture
async def serve():
    tasks = []

    async def start(*args, **options):
        tasks.append(asyncio.create_task(server(*args, **options)))
        await asyncio.sleep(0)
        await asyncio.sleep(0)

    yield start
    for task in tasks:
        task.cancel()
    await asyncio.gather(*tasks, return_exceptions=True)


def plan(*values, service="/add_two_ints", **options):
    return Plan(service, values=values, remote=Remote(transport="memory"), **options)


def type_of(folder, name, text):
    """The class of a type that this process finds nowhere."""
    package, kind, stem = name.split("/")
    path = folder / package / kind / f"{stem}.{kind}"
    path.parent.mkdir(parents=True)
    path.write_text(text, encoding="utf-8")
    return srvgen.define(name, Search([folder]).full_text(name))


def now() -> float:
    return asyncio.get_running_loop().time()


async def test_a_call_prints_what_ros2_prints(serve, capsys):
    await serve()
    await perform(plan("{a: 2, b: 3}", type_name="example_interfaces/srv/AddTwoInts"))
    assert capsys.readouterr() == (ANSWER, "")


@pytest.mark.parametrize("type_name", ["", "example_interfaces/AddTwoInts"])
@pytest.mark.parametrize("service", ["add_two_ints", "/add_two_ints"])
async def test_type_and_slash_may_be_left_out(serve, capsys, type_name, service):
    await serve()
    await perform(plan("a=2", "b=3", service=service, type_name=type_name))
    assert capsys.readouterr().out == ANSWER


async def test_json_is_one_line_of_the_response(serve, capsys):
    await serve()
    await perform(plan("a=2", "b=3", as_json=True))
    assert capsys.readouterr() == ('{"sum": 5}\n', "")


async def test_json_has_null_for_nan_and_infinity(serve, capsys):
    def odd(request, response):
        response.float64_value = float("nan")
        response.float32_value = float("-inf")
        return response

    await serve(odd, type_=BASIC)
    await perform(plan(as_json=True))
    answer = json.loads(capsys.readouterr().out, parse_constant=lambda name: pytest.fail(name))
    assert answer["float64_value"] is None
    assert answer["float32_value"] is None


async def test_call_waits_for_a_later_service_and_reports_it_once(serve, capsys):
    await serve(after=3.0)
    await perform(plan("a=2", "b=3"))
    assert capsys.readouterr() == (ANSWER, "waiting for service to become available...\n")
    assert now() == pytest.approx(3.0, abs=0.2)


async def test_wait_for_a_missing_service_ends_at_the_deadline(capsys):
    with pytest.raises(
        ServiceUnavailable, match=r"no server offers /add_two_ints \(waited 10 s\)"
    ) as e:
        await perform(plan("a=2"))
    assert exit_code(e.value) is Exit.NOT_RUN
    assert now() == pytest.approx(10.0, abs=0.1)


async def test_waiting_and_call_share_the_timeout(serve, capsys):
    async def slow(request, response):
        await asyncio.sleep(5.0)
        return response

    await serve(slow, after=3.0)
    with pytest.raises(DeadlineExceeded, match="within 4 s; the call may have run") as caught:
        await perform(plan(timeout=4.0))
    assert exit_code(caught.value) is Exit.DEADLINE
    assert now() == pytest.approx(4.0, abs=0.1)


async def test_shorter_limit_of_a_gateway_is_not_shown_as_the_timeout_of_the_command():
    def refuse(deferred):
        error = DeadlineExceeded("the robot did not respond within 1 s")
        asyncio.get_running_loop().call_later(1, deferred.fail, error)

    async with taskrpc.Node("gateway", transport="memory") as node:
        node.create_deferred_service(ADD, "/add_two_ints", refuse)
        with pytest.raises(DeadlineExceeded, match="the robot did not respond within 1 s"):
            await perform(plan(timeout=4.0))


async def test_call_without_a_timeout_waits_for_service_and_response_without_limit(serve, capsys):
    async def slow(request, response):
        await asyncio.sleep(60.0)
        return add(request, response)

    await serve(slow, after=60.0)
    await perform(plan("a=2", "b=3", timeout=None))
    assert capsys.readouterr() == (ANSWER, "waiting for service to become available...\n")
    assert now() == pytest.approx(120.0, abs=0.2)


@pytest.mark.parametrize(("text", "limit"), [("0", None), ("inf", None), ("2.5", 2.5)])
def test_timeout_0_and_inf_mean_no_time_limit(text, limit):
    parser = Parser()
    configure(parser)
    assert parser.parse_args(["/add_two_ints", "--timeout", text]).timeout == limit


async def test_json_prints_only_the_response(serve, capsys):
    await serve(after=1.0)
    await perform(plan("a=2", "b=3", as_json=True))
    assert capsys.readouterr() == ('{"sum": 5}\n', "")


async def test_count_repeats_the_call(serve, capsys):
    await serve()
    await perform(plan("a=2", "b=3", count=3))
    assert capsys.readouterr().out == ANSWER * 3


async def test_rate_spaces_the_calls_from_their_start(serve):
    times = []

    async def note(request, response):
        times.append(now())
        await asyncio.sleep(0.2)
        return response

    await serve(note)
    await perform(plan(count=4, rate=2.0))
    assert times == pytest.approx([0.0, 0.5, 1.0, 1.5], abs=0.01)


@pytest.mark.parametrize(
    "values", [["{start: {header: auto}}"], ["start.header.stamp=now", "tolerance=1.5"]]
)
async def test_auto_and_now_are_the_time_of_each_call(serve, monkeypatch, values):
    seconds = itertools.count(7)
    monkeypatch.setattr("time.time_ns", lambda: next(seconds) * 10**9 + 5)
    stamps = []

    def plan_path(request, response):
        stamps.append(request.start.header.stamp)
        return response

    await serve(plan_path, type_=srvgen.load("nav_msgs/srv/GetPlan"))
    await perform(plan(*values, count=2))
    first, second = stamps
    assert second.sec > first.sec >= 7
    assert first.nanosec == 5


async def test_retries_repeat_calls_that_certainly_did_not_run(serve, capsys):
    tries = []

    def busy(request, response):
        tries.append(now())
        if len(tries) < 3:
            raise taskrpc.HandlerError("UNAVAILABLE", "not yet")
        return response

    await serve(busy)
    await perform(plan(retries=2))
    assert len(tries) == 3


async def test_first_failure_ends_a_call_without_retries(serve):
    def busy(request, response):
        raise taskrpc.HandlerError("UNAVAILABLE", "not yet")

    await serve(busy)
    with pytest.raises(HandlerFailed, match="not yet") as caught:
        await perform(plan())
    assert exit_code(caught.value) is Exit.ERROR
    assert caught.value.code is Code.UNAVAILABLE


async def test_wrong_type_is_reported_at_once(serve):
    await serve()
    problem = (
        "/add_two_ints is offered as example_interfaces/srv/AddTwoInts, not as std_srvs/srv/Empty"
    )
    with pytest.raises(TypeMismatch, match=problem):
        await perform(plan(type_name="std_srvs/srv/Empty"))
    assert now() == 0.0


@pytest.mark.parametrize("started", [True, False])
@pytest.mark.parametrize(
    ("type_name", "problem"),
    [
        ("foo/srv/Bar", "The passed service type is invalid"),
        ("std_msgs/msg/String", "The passed type is not a service"),
    ],
)
async def test_invalid_service_type_is_reported_without_waiting(serve, started, type_name, problem):
    if started:
        await serve()
    with pytest.raises(srvgen.DefinitionError, match=problem):
        await perform(plan(type_name=type_name))
    assert now() == 0.0


async def test_invalid_request_of_a_known_type_is_reported_without_waiting():
    with pytest.raises(InvalidRequest, match="has no attribute 'c'"):
        await perform(plan("c=1", type_name="example_interfaces/srv/AddTwoInts"))
    assert now() == 0.0


async def test_type_that_only_the_server_has_is_used_with_its_definition(serve, capsys, tmp_path):
    text = "string word\nint8[] numbers\n---\nstring back\n"
    own = type_of(tmp_path, "far_away/srv/Spell", text)

    def spell(request, response):
        response.back = request.word[::-1]
        return response

    await serve(spell, type_=own)
    await perform(plan("word=abc", "numbers=[1, 2]", type_name="far_away/srv/Spell", as_json=True))
    assert capsys.readouterr().out == '{"back": "cba"}\n'


async def test_differing_definition_is_reported_if_the_request_does_not_fit(serve, tmp_path):
    own = type_of(tmp_path, "std_srvs/srv/SetBool", "bool on\n---\nbool success\n")
    await serve(add, type_=own)
    with pytest.raises(InvalidRequest) as caught:
        await perform(plan("data=true"))
    assert caught.value.__notes__ == [
        "SetBool_Request has on",
        "the server's definition differs from the one on this machine",
    ]


async def test_invalid_name_is_reported_with_a_caret():
    with pytest.raises(InvalidName, match=r"\n  '/bad name'\n       \^$"):
        await perform(plan(service="/bad name"))
