"""Services that a client of rosbridge offers."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc.bridges.rosbridge import session
from tests.bridges.rosbridge.clients import connected

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
OFFER = {"service": "add", "type": "example_interfaces/AddTwoInts"}


async def begun(node, client):
    """A call of a program to the client's service, and the operation that the client got."""
    call = asyncio.ensure_future(node.create_client(ADD, "/add").call(ADD.Request(a=1, b=2)))
    return call, await client.next(op="call_service")


async def test_client_answers_a_call_of_a_program():
    async with connected() as (node, client):
        await client.send("advertise_service", **OFFER)
        call, got = await begun(node, client)
        assert (got["service"], got["args"]) == ("add", {"a": 1, "b": 2})
        fields = {"id": got["id"], "service": "add", "result": True}
        await client.send("service_response", values={"sum": 3}, **fields)
        assert (await call).sum == 3


async def test_one_client_calls_the_service_of_another():
    async with connected(2) as (_, one, other):
        await one.send("advertise_service", **OFFER)
        await other.send("call_service", service="/add", args=[1, 2], id="c")
        got = await one.next(op="call_service")
        await one.send("service_response", id=got["id"], values={"sum": 3}, result=True)
        assert (await other.next())["values"] == {"sum": 3}


@pytest.mark.parametrize(
    ("response", "problem"),
    [
        ({"result": False, "values": "no battery"}, "no battery"),
        ({"result": False}, "the service failed"),
        ({"result": True, "values": {"sum": "x"}}, "sent an invalid response: sum: expected int64"),
        ({"result": True, "values": 5}, "sent an invalid response: expected the fields of"),
    ],
)
async def test_caller_gets_the_failure_of_the_client(response, problem):
    async with connected() as (node, client):
        await client.send("advertise_service", **OFFER)
        call, got = await begun(node, client)
        await client.send("service_response", id=got["id"], **response)
        with pytest.raises(taskrpc.HandlerFailed, match=problem):
            await call
        told = [each["msg"] for each in client.sent if each["op"] == "status"]
        assert bool(told) == ("invalid" in problem)


async def test_open_call_ends_when_the_client_leaves():
    async with connected() as (node, client):
        await client.send("advertise_service", **OFFER)
        call, _ = await begun(node, client)
        client.session.close()
        with pytest.raises(taskrpc.OutcomeUnknown):
            await call
        with pytest.raises(taskrpc.ServiceUnavailable):
            await node.create_client(ADD, "/add").call(ADD.Request())


async def test_response_to_a_call_that_its_caller_has_cancelled_does_no_harm():
    async with connected() as (node, client):
        await client.send("advertise_service", **OFFER)
        call, got = await begun(node, client)
        call.cancel()
        await asyncio.sleep(1)
        await client.send("service_response", id=got["id"], values={"sum": 3})
        assert client.sent == []


async def test_unadvertised_service_is_gone_and_a_second_time_is_a_mistake():
    async with connected() as (node, client):
        await client.send("advertise_service", **OFFER)
        await client.send("unadvertise_service", service="/add")
        assert not await node.create_client(ADD, "/add").wait_for_service(timeout=1)
        await client.send("unadvertise_service", service="/add")
        assert "does not offer /add" in (await client.next())["msg"]


async def test_service_that_is_offered_again_replaces_the_earlier_one():
    async with connected() as (node, client):
        await client.send("advertise_service", **OFFER)
        await client.send("advertise_service", **OFFER)
        call, got = await begun(node, client)
        await client.send("service_response", id=got["id"], values={"sum": 3})
        assert (await call).sum == 3
        assert client.sent == []


async def test_response_to_a_call_of_the_replaced_service_answers_no_later_call():
    async with connected() as (node, client):
        await client.send("advertise_service", **OFFER)
        call, got = await begun(node, client)
        await client.send("advertise_service", **OFFER)  # the program of the client began again
        with pytest.raises(taskrpc.OutcomeUnknown):
            await call
        later, its = await begun(node, client)
        await client.send("service_response", id=got["id"], values={"sum": -1})
        await client.send("service_response", id=its["id"], values={"sum": 3})
        assert (await later).sum == 3


@pytest.mark.parametrize(
    ("type_name", "problem"),
    [
        ("nothing/Here", "package 'nothing' not found"),
        ("std_msgs/msg/String", "expected a service type"),
    ],
)
async def test_service_of_an_unknown_type_is_refused(type_name, problem):
    async with connected() as (_, client):
        await client.send("advertise_service", service="/x", type=type_name)
        assert problem in (await client.next(op="status"))["msg"]


async def test_number_of_offered_services_is_limited(monkeypatch):
    monkeypatch.setattr(session, "MAX_SERVICES", 1)
    async with connected() as (_, client):
        await client.send("advertise_service", **OFFER)
        await client.send("advertise_service", **OFFER | {"service": "/other"})
        assert "expected at most 1 services of one client" in (await client.next())["msg"]
