"""A program measures its calls while another program watches it, and only then."""

from __future__ import annotations

import asyncio

import pytest

import taskrpc
from taskrpc.core.observer import Observer
from taskrpc.core.transport.connection.server_side import ServingConnection
from taskrpc.core.wire.messages import Resolved, encode
from taskrpc.core.wire.statistics import ServiceStatistics
from taskrpc.errors import HandlerError
from tests.core.transport.helpers import Add, add, ask


def program(name, **settings):
    return taskrpc.Node(name, transport="memory", listen=name, **settings)


async def of(watcher, service="/add", node="/server"):
    (found,) = [each for each in await watcher.statistics() if node in each.entry.nodes]
    assert found.statistics is not None, found.problem
    (counts,) = [each for each in found.statistics.services if each.name == service]
    return found.statistics, counts


async def test_calls_count_from_the_first_question_on():
    async with program("server") as server, program("ada") as ada, program("top") as top:
        server.create_service(Add, "add", add)
        client = ada.create_client(Add, "add")
        await client.call(ask(1))
        _, counts = await of(top)
        assert counts == ServiceStatistics("/add", 0, 0)
        for number in range(3):
            await client.call(ask(number))
        statistics, counts = await of(top)
        assert counts.codes == {0: 3}
        assert sum(counts.durations.values()) == 3
        assert statistics.callers == {"/ada": 3}
        assert statistics.connections == 1


async def test_clients_that_connect_later_count_too():
    async with program("server") as server, program("top") as top:
        server.create_service(Add, "add", add)
        await of(top)
        async with program("ada") as ada:
            await ada.create_client(Add, "add").call(ask(1))
        statistics, counts = await of(top)
        assert counts.codes == {0: 1}
        assert statistics.callers == {"/ada": 1}


async def test_calls_of_the_watcher_do_not_count():
    async with program("server") as server, program("top") as top:
        server.create_service(Add, "add", add)
        client = top.create_client(Add, "add")
        await client.call(ask(1))
        await of(top)
        await client.call(ask(2))
        statistics, counts = await of(top)
        assert (counts.codes, statistics.callers, statistics.connections) == ({}, {}, 0)


async def test_measuring_ends_with_the_last_watcher():
    async with program("server") as server, program("ada") as ada:
        server.create_service(Add, "add", add)
        client = ada.create_client(Add, "add")
        async with program("top") as top:
            async with program("second") as second:
                await of(top)
                await of(second)
            await client.call(ask(1))
            _, counts = await of(top)
            assert counts.codes == {0: 1}
        await asyncio.sleep(1)
        await client.call(ask(1))
        async with program("again") as again:
            _, counts = await of(again)
            assert counts.codes == {}


async def test_calls_without_watchers_have_no_observer():
    seen = []
    async with program("server") as server, program("ada") as ada:
        server.create_service(Add, "add", add)
        client = ada.create_client(Add, "add")

        def look(request, response):
            seen.append(type(taskrpc.current_call()).__name__)
            return add(request, response)

        server.create_service(Add, "look", look)
        client = ada.create_client(Add, "look")
        await client.call(ask(1))
        async with program("top") as top:
            await of(top)
            await client.call(ask(1))
        await asyncio.sleep(1)
        await client.call(ask(1))
    assert seen == ["RemoteCall", "ObservedCall", "RemoteCall"]


async def test_errors_count_by_status_code():
    def refuse(request, response):
        raise HandlerError("NOT_FOUND", "no such thing")

    async with program("server") as server, program("ada") as ada, program("top") as top:
        server.create_service(Add, "add", refuse)
        await of(top)
        with pytest.raises(taskrpc.HandlerFailed):
            await ada.create_client(Add, "add").call(ask(1))
        _, counts = await of(top)
        assert counts.codes == {int(taskrpc.Code.NOT_FOUND): 1}


async def test_durations_are_from_arrival_to_response():
    async def slow(request, response):
        await asyncio.sleep(0.3)
        return add(request, response)

    async with program("server") as server, program("ada") as ada, program("top") as top:
        server.create_service(Add, "add", slow)
        await of(top)
        client = ada.create_client(Add, "add")
        calls = [client.call_async(ask(1)) for _ in range(2)]
        await asyncio.sleep(0.1)
        _, counts = await of(top)
        assert (counts.running, counts.waiting) == (1, 1)
        await asyncio.gather(*calls)
        _, counts = await of(top)
        assert sorted(counts.durations.items()) == [(73, 1), (77, 1)]  # 0.3 s and 0.6 s


async def test_an_observer_of_the_node_gets_its_reports_as_before():
    class Own(Observer):
        ended = 0

        def call_ended(self, call, code, seconds):
            self.ended += 1

    own = Own()
    async with program("server", observer=own) as server, program("ada") as ada:
        server.create_service(Add, "add", add)
        client = ada.create_client(Add, "add")
        async with program("top") as top:
            for _ in range(2):
                await of(top)
                await client.call(ask(1))
            assert (await of(top))[1].codes == {0: 2}
        await asyncio.sleep(1)
        await client.call(ask(1))
    assert own.ended == 3


async def test_a_program_that_offers_nothing_has_neither_statistics_nor_a_problem():
    async with program("ada"), program("top") as top:
        (found,) = [each for each in await top.statistics() if each.entry.nodes == ("/ada",)]
        assert (found.statistics, found.problem) == (None, "")


async def test_a_program_that_does_not_answer_has_a_problem_after_the_timeout(monkeypatch):
    monkeypatch.setitem(ServingConnection.handlers, _resolve_event(), lambda self, event: None)
    async with program("server") as server, program("top") as top:
        server.create_service(Add, "add", add)
        began = asyncio.get_running_loop().time()
        (found,) = await top.statistics(0.8)
        assert found.problem == "it did not respond in time"
        assert asyncio.get_running_loop().time() - began < 1


async def test_an_answer_that_is_no_statistics_is_a_problem(monkeypatch):
    def wrong(self, event):
        self.session.respond(event.call_id, encode(Resolved(1, 0, "", "", "", b"")))

    monkeypatch.setitem(ServingConnection.handlers, _resolve_event(), wrong)
    async with program("server") as server, program("top") as top:
        server.create_service(Add, "add", add)
        (found,) = await top.statistics()
        assert "Statistics is not valid" in found.problem


def _resolve_event():
    from taskrpc.core.wire.events import ResolveReceived

    return ResolveReceived
