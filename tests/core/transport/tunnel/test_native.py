"""Programs that are not taskrpc's call our services, and we call theirs, by native services."""

import asyncio

import pytest

import srvgen
import taskrpc
from taskrpc import QoS
from taskrpc.core.transport.discovery.entries import EntryChange
from taskrpc.core.transport.engine import ForeignServer
from taskrpc.core.transport.tunnel.native import MOST_IN_FLIGHT
from taskrpc.core.wire.messages import ServiceEndpoint, TopicEndpoint
from taskrpc.testing.memory_engine import MemoryEngine
from tests.core.transport.helpers import Add, Gate, add, ask, outcome, until, until_seen

Int32 = srvgen.load("std_msgs/msg/Int32")
Other = srvgen.define("example_interfaces/srv/AddTwoInts", "int64 a\n---\nint64 sum\n")


class Robot:
    """A foreign program with a service `/move` that responds when the test says so."""

    def __init__(self, engine, srv_type=Add, *, at_once=False):
        self.engine, self.srv_type, self.at_once = engine, srv_type, at_once
        self.calls = []
        """The requests so far, with the ways back."""
        self.server = self.serve()

    def serve(self):
        named = ServiceEndpoint("/move", self.srv_type._TYPE, self.srv_type._HASH, "/robot")
        return self.engine.serve(named, self.srv_type, self._arrived)

    def _arrived(self, request, reply):
        self.calls.append((request, reply))
        if self.at_once:
            self.respond()

    def respond(self, number=-1):
        request, reply = self.calls[number]
        reply.reply(add(request, Add.Response()))


async def robot_and_client(programs, **options):
    robot = Robot(await programs.foreign(), **options)
    client = (await programs.node("client")).create_client(Add, "move")
    assert await client.wait_for_service(60)
    return robot, client


async def native_call(engine, service, request, srv_type=Add):
    """Call natively from a foreign program; return the response or the error."""
    done = asyncio.get_running_loop().create_future()
    engine.call(service, srv_type, request, lambda *result: done.set_result(result))
    response, error = await done
    return error or response


# Our client, their server


async def test_a_foreign_server_is_called(programs):
    _, client = await robot_and_client(programs, at_once=True)
    assert (await client.call(ask(1, 2))).sum == 3
    assert [(await call).sum for call in [client.call_async(ask(n)) for n in range(5)]] == [
        *range(5)
    ]


async def test_a_client_that_waits_finds_a_foreign_server_when_it_comes(programs):
    client = (await programs.node("client")).create_client(Add, "move")
    assert isinstance(await outcome(client.call(ask())), taskrpc.ServiceUnavailable)
    waiting = asyncio.ensure_future(client.wait_for_service(60))
    await asyncio.sleep(1)
    Robot(await programs.foreign(), at_once=True)
    assert await waiting
    assert (await client.call(ask(1))).sum == 1


async def test_a_deadline_ends_a_native_call_and_the_engine_forgets_it(programs):
    robot, client = await robot_and_client(programs)
    with pytest.raises(taskrpc.DeadlineExceeded) as caught:
        await client.call(ask(), timeout=1)
    assert caught.value.not_executed is None
    ((_, reply),) = robot.calls
    assert reply.is_over
    robot.respond()
    await asyncio.sleep(1)
    robot.at_once = True
    assert (await client.call(ask(2))).sum == 2


async def test_cancelling_a_call_cancels_the_native_one(programs):
    robot, client = await robot_and_client(programs)
    call = client.call_async(ask())
    await until(lambda: robot.calls)
    call.cancel()
    await until(lambda: robot.calls[0][1].is_over)


async def test_another_definition_is_refused_with_both_hashes(programs):
    Robot(await programs.foreign(), Other)
    client = (await programs.node("client")).create_client(Add, "move")
    with pytest.raises(taskrpc.TypeMismatch) as caught:
        await client.call(ask())
    assert Add._HASH[:15] in str(caught.value)
    assert Other._HASH[:15] in str(caught.value)


async def test_a_server_whose_hash_is_unknown_is_called_if_its_type_has_the_same_name(
    programs, monkeypatch
):
    monkeypatch.setattr(
        MemoryEngine,
        "foreign_servers",
        lambda self, service: [ForeignServer(Add._TYPE, "", "/robot")] if self._foreign() else [],
    )
    _, client = await robot_and_client(programs, at_once=True)
    assert (await client.call(ask(1))).sum == 1


async def test_calls_end_at_once_when_the_foreign_server_goes(programs):
    robot, client = await robot_and_client(programs)
    calls = [client.call_async(ask(n), timeout=None) for n in range(MOST_IN_FLIGHT + 2)]
    await until(lambda: len(robot.calls) == MOST_IN_FLIGHT)
    robot.engine.close()
    results = [await outcome(call) for call in calls]
    assert {type(each) for each in results[:MOST_IN_FLIGHT]} == {taskrpc.OutcomeUnknown}
    assert {type(each) for each in results[MOST_IN_FLIGHT:]} == {taskrpc.ServiceUnavailable}
    with pytest.raises(taskrpc.ServiceUnavailable, match="no server offers /move"):
        await client.call(ask())
    again = Robot(await programs.foreign(), at_once=True)
    assert await client.wait_for_service(60)
    assert (await client.call(ask(7))).sum == 7
    assert len(again.calls) == 1


async def test_a_server_that_comes_back_with_another_type_is_another_server(programs):
    robot, client = await robot_and_client(programs)
    call = client.call_async(ask(), timeout=None)
    await until(lambda: robot.calls)
    robot.server.close()
    Robot(robot.engine, Other)
    assert isinstance(await outcome(call), taskrpc.OutcomeUnknown)
    assert isinstance(await outcome(client.call(ask())), taskrpc.TypeMismatch)


async def test_a_foreign_server_gets_ten_calls_at_a_time_in_order(programs):
    robot, client = await robot_and_client(programs)
    calls = [client.call_async(ask(n)) for n in range(50)]
    for number in range(50):
        await until(lambda: len(robot.calls) > number)  # noqa: B023
        assert len(robot.calls) <= number + MOST_IN_FLIGHT
        robot.respond(number)
    assert [(await call).sum for call in calls] == [*range(50)]
    assert [request.a for request, _ in robot.calls] == [*range(50)]


async def test_a_cancelled_call_that_waits_is_never_sent(programs):
    robot, client = await robot_and_client(programs)
    calls = [client.call_async(ask(n)) for n in range(MOST_IN_FLIGHT + 2)]
    await until(lambda: len(robot.calls) == MOST_IN_FLIGHT)
    calls[-2].cancel()
    calls[0].cancel()
    await until(lambda: len(robot.calls) > MOST_IN_FLIGHT)
    robot.respond()
    assert (await calls[-1]).sum == MOST_IN_FLIGHT + 1
    assert MOST_IN_FLIGHT not in [request.a for request, _ in robot.calls]
    for number in range(1, MOST_IN_FLIGHT):
        robot.respond(number)
    await asyncio.gather(*calls[1:-2])


async def test_a_program_that_ends_leaves_no_call_and_no_task(programs):
    robot = Robot(await programs.foreign())
    before = asyncio.all_tasks()
    async with taskrpc.Node("brief", transport="tunnel", listen="brief") as brief:
        brief.create_service(Add, "add", add)
        client = brief.create_client(Add, "move")
        assert await client.wait_for_service(60)
        calls = [client.call_async(ask()) for _ in range(MOST_IN_FLIGHT + 1)]
        await until(lambda: len(robot.calls) == MOST_IN_FLIGHT)
    results = [await outcome(call) for call in calls]
    # The foreign server is still there, so the error does not say that it has left.
    assert {str(each) for each in results[:-1]} == {"the node was destroyed"}
    assert {type(each) for each in results[:-1]} == {taskrpc.OutcomeUnknown}
    assert isinstance(results[-1], taskrpc.TaskRpcError)
    assert all(reply.is_over for _, reply in robot.calls)
    assert asyncio.all_tasks() == before
    assert isinstance(await native_call(robot.engine, "/add", ask()), taskrpc.ServiceUnavailable)


async def test_the_error_of_an_engine_reaches_the_caller(programs):
    robot, client = await robot_and_client(programs)
    call = client.call_async(ask())
    await until(lambda: robot.calls)
    robot.calls[0][1].fail(taskrpc.HandlerFailed("NOT_FOUND", "no such place"))
    with pytest.raises(taskrpc.HandlerFailed, match="no such place"):
        await call


async def test_an_unexpected_error_of_an_engine_leaves_the_outcome_unknown(programs, monkeypatch):
    _, client = await robot_and_client(programs)

    class Lost:
        def cancel(self): ...

    def call(self, service, srv_type, request, on_done):
        asyncio.get_running_loop().call_soon(on_done, None, OSError("broken"))
        return Lost()

    monkeypatch.setattr(MemoryEngine, "call", call)
    assert isinstance(await outcome(client.call(ask())), taskrpc.OutcomeUnknown)


async def test_a_request_that_the_engine_refuses_did_not_run(programs, monkeypatch):
    _, client = await robot_and_client(programs)

    def call(self, service, srv_type, request, on_done):
        raise taskrpc.InvalidRequest("a", "too large for this middleware")

    monkeypatch.setattr(MemoryEngine, "call", call)
    with pytest.raises(taskrpc.InvalidRequest, match="too large"):
        await client.call(ask())


async def test_a_response_that_is_not_valid_is_the_servers_failure(programs, monkeypatch):
    _, client = await robot_and_client(programs)

    class Done:
        def cancel(self): ...

    def call(self, service, srv_type, request, on_done):
        asyncio.get_running_loop().call_soon(on_done, "no message", None)
        return Done()

    monkeypatch.setattr(MemoryEngine, "call", call)
    with pytest.raises(taskrpc.HandlerFailed, match="the foreign server's response is not valid"):
        await client.call(ask())


async def test_a_taskrpc_server_is_preferred_to_a_foreign_one(programs):
    robot = Robot(await programs.foreign(), at_once=True)
    server = await programs.node("server")
    server.create_service(Add, "move", add)
    client = (await programs.node("client")).create_client(Add, "move")
    assert await client.wait_for_service(60)
    await until_seen(server, lambda entries: len(entries) == 3)
    assert (await client.call(ask(1, 2))).sum == 3
    assert not robot.calls
    await server.destroy()
    assert await client.wait_for_service(60)
    assert (await client.call(ask(1, 2))).sum == 3
    assert len(robot.calls) == 1


async def test_the_definition_of_a_foreign_service_is_the_one_of_this_program(programs):
    Robot(await programs.foreign())
    node = await programs.node("node")
    await until_seen(node, lambda entries: any(each.offers("/move") for each in entries))
    name, text = await node.definition("move")
    assert (name, text) == (Add._TYPE, Add._DEFINITION)


async def test_a_foreign_service_of_an_unknown_type_has_no_definition(programs):
    unknown = srvgen.define("robot_lab/srv/Unheard", "int64 a\n---\nint64 sum\n")
    Robot(await programs.foreign(), unknown)
    node = await programs.node("node")
    await until_seen(node, lambda entries: any(each.offers("/move") for each in entries))
    with pytest.raises(taskrpc.TaskRpcError, match=r"robot_lab/srv/Unheard.*\.srv file"):
        await node.definition("move")


@pytest.mark.parametrize("name", ["", "x", "../../etc/passwd", "a/srv/b", "a/srv/B/C", "a/msg/\0"])
async def test_an_invalid_type_name_of_a_foreign_server_is_only_a_mismatch(
    programs, monkeypatch, name
):
    monkeypatch.setattr(
        MemoryEngine, "foreign_servers", lambda self, service: [ForeignServer(name, "", "/robot")]
    )
    client = (await programs.node("client")).create_client(Add, "move")
    assert isinstance(await outcome(client.call(ask())), taskrpc.TypeMismatch)


# Their client, our server


async def test_a_foreign_client_calls_our_service(programs):
    server = await programs.node("server")
    callers = []

    def callback(request, response):
        call = taskrpc.current_call()
        callers.append((call.caller, call.service, call.deadline, call.principal))
        return add(request, response)

    server.create_service(Add, "add", callback)
    robot = await programs.foreign()
    robot.update(EntryChange(node="/robot"))
    assert (await native_call(robot, "/add", ask(1, 2))).sum == 3
    assert callers == [("/robot", "/add", None, "")]


@pytest.mark.parametrize("threaded", [False, True])
async def test_a_failed_handler_is_told_to_a_foreign_client(programs, threaded, caplog):
    server = await programs.node("server")
    server.create_service(Add, "fail", lambda *_: 1 / 0, threaded=threaded)
    server.create_service(Add, "none", lambda *_: None, threaded=threaded)
    robot = await programs.foreign()
    for name in ("/fail", "/none"):
        error = await native_call(robot, name, ask())
        assert isinstance(error, taskrpc.HandlerFailed)
    assert "ZeroDivisionError" in caplog.text


async def test_foreign_calls_wait_their_turn_with_all_others(programs):
    server = await programs.node("server")
    gate = Gate()
    server.create_service(Add, "gate", gate)
    robot = await programs.foreign()
    calls = [asyncio.ensure_future(native_call(robot, "/gate", ask(n))) for n in range(5)]
    await until(lambda: gate.started)
    await asyncio.sleep(1)
    assert gate.started == [0]
    gate.opened.set()
    assert [each.sum for each in await asyncio.gather(*calls)] == [*range(5)]


async def test_a_deferred_service_responds_to_a_foreign_client_later(programs):
    server = await programs.node("server")
    taken = []
    server.create_deferred_service(Add, "later", taken.append)
    robot = await programs.foreign()
    call = asyncio.ensure_future(native_call(robot, "/later", ask(4)))
    await until(lambda: taken)
    taken[0].reply(Add.Response(sum=9))
    assert (await call).sum == 9


async def test_an_exactly_once_service_serves_foreign_clients_without_that_promise(programs):
    server = await programs.node("server")
    server.create_service(Add, "once", add, exactly_once=taskrpc.MemoryCompletions())
    robot = await programs.foreign()
    assert (await native_call(robot, "/once", ask(1, 2))).sum == 3


async def test_a_service_that_ends_is_withdrawn_natively_too(programs):
    server = await programs.node("server")
    service = server.create_service(Add, "add", add)
    robot = await programs.foreign()
    assert (await native_call(robot, "/add", ask(1))).sum == 1
    service.destroy()
    error = await native_call(robot, "/add", ask(1))
    assert isinstance(error, taskrpc.ServiceUnavailable)
    server.create_service(Add, "add", add)
    assert (await native_call(robot, "/add", ask(1))).sum == 1


async def test_a_service_that_the_middleware_refuses_is_not_offered_at_all(programs, monkeypatch):
    def serve(self, named, srv_type, serve):
        raise taskrpc.TaskRpcError("the package my_interfaces is not built")

    server, client = await programs.node("server"), await programs.node("client")
    with monkeypatch.context() as patch:
        patch.setattr(MemoryEngine, "serve", serve)
        with pytest.raises(taskrpc.TaskRpcError, match="is not built"):
            server.create_service(Add, "add", add)
    await asyncio.sleep(0.1)
    assert not any(each.offers("/add") for each in await client.graph())
    server.create_service(Add, "add", add)


class Notes(taskrpc.Observer):
    """Records what an observer hears."""

    def __init__(self):
        self.log = []

    def call_began(self, call):
        self.log.append(("began", call.service, call.caller))

    def call_answered(self, call, response):
        self.log.append(("answered", response.sum))

    def call_ended(self, call, code, seconds):
        self.log.append(("ended", code, seconds))


async def test_observers_hear_of_foreign_calls(programs, caplog):
    notes, later = Notes(), Notes()
    server = await programs.node("server", observer=notes)
    service = server.create_service(Add, "add", add)
    server.create_service(Add, "fail", lambda *_: 1 / 0)
    robot = await programs.foreign()
    robot.update(EntryChange(node="/robot"))
    await native_call(robot, "/add", ask(1, 2))
    await native_call(robot, "/fail", ask())
    assert notes.log == [
        ("began", "/add", "/robot"),
        ("answered", 3),
        ("ended", taskrpc.Code.OK, 0.0),
        ("began", "/fail", "/robot"),
        ("ended", taskrpc.Code.INTERNAL, 0.0),
    ]
    notes.log.clear()
    service.observe(later)
    await native_call(robot, "/add", ask(2, 2))
    assert (notes.log, later.log[1]) == ([], ("answered", 4))
    service.destroy()
    assert isinstance(await native_call(robot, "/add", ask(1)), taskrpc.ServiceUnavailable)


@pytest.mark.parametrize(
    "settings",
    [
        {"token": "secret"},
        {"accounts": taskrpc.Accounts([taskrpc.Account("ana", "anas-secret-anas")])},
    ],
    ids=lambda it: next(iter(it)),
)
async def test_a_program_with_a_secret_has_no_native_side(programs, settings):
    """A foreign program cannot prove anything."""
    server = await programs.node("server", **settings)
    server.create_service(Add, "add", add)
    publisher = server.create_publisher(Int32, "count")
    robot = await programs.foreign()
    error = await native_call(robot, "/add", ask())
    assert isinstance(error, taskrpc.ServiceUnavailable)
    Robot(robot)
    client = server.create_client(Add, "move")
    assert not await client.wait_for_service(1)
    got = []
    named = TopicEndpoint("/count", Int32._TYPE, Int32._HASH, "/robot", 10, True, False)
    robot.create_subscription(named, Int32, lambda body, _: got.append(body), None)
    await asyncio.sleep(1)
    publisher.publish(Int32(data=1))
    await asyncio.sleep(1)
    assert not got


# Topics and the graph


async def test_topics_reach_foreign_programs_and_come_from_them(programs):
    node, robot = await programs.node("node"), await programs.foreign()
    ours, theirs = [], []
    there = TopicEndpoint("/there", Int32._TYPE, Int32._HASH, "/robot", 10, True, False)
    here = TopicEndpoint("/here", Int32._TYPE, Int32._HASH, "/robot", 10, True, False)
    incoming = robot.create_subscription(
        there, Int32, lambda body, _: theirs.append(incoming.decode(body).data), None
    )
    outgoing = robot.create_publisher(here, Int32, None)
    publisher = node.create_publisher(Int32, "there")
    subscription = node.create_subscription(Int32, "here", lambda it: ours.append(it.data))
    await until(lambda: publisher.get_subscription_count() and subscription.get_publisher_count())
    publisher.publish(Int32(data=1))
    outgoing.publish(outgoing.encode(Int32(data=2)))
    await until(lambda: ours and theirs)
    assert (ours, theirs) == ([2], [1])
    assert (publisher.sent, subscription.received) == (1, 1)
    changes = []
    publisher.on_matched = lambda: changes.append(publisher.get_subscription_count())
    subscription.on_matched = lambda: changes.append(subscription.get_publisher_count())
    incoming.close()
    outgoing.close()
    await until(lambda: changes == [0, 0])


async def test_a_foreign_topic_that_does_not_match_is_reported(programs):
    node, robot = await programs.node("node"), await programs.foreign()
    problems = []
    node.create_subscription(
        Int32, "t", print, QoS(durability="transient_local"), on_mismatch=problems.append
    )
    named = TopicEndpoint("/t", Int32._TYPE, Int32._HASH, "/robot", 10, True, False)
    robot.create_publisher(named, Int32, None)
    await until(lambda: problems == ["DURABILITY"])


async def test_the_graph_shows_foreign_nodes(programs):
    robot = Robot(await programs.foreign())
    robot.engine.update(EntryChange(node="/robot"))
    node = await programs.node("node")
    publisher = node.create_publisher(Int32, "t")

    def robots(entries):
        return [each for each in entries if "/robot" in each.nodes]

    await until_seen(node, robots)
    (entry,) = robots(await node.graph())
    assert [each.name for each in entry.services] == ["/move"]
    assert entry.address == ""
    (own,) = [each for each in await node.graph() if "/node" in each.nodes]
    assert [each.name for each in own.publishers] == ["/t"]
    publisher.destroy()
    (own,) = [each for each in await node.graph() if "/node" in each.nodes]
    assert own.publishers == ()
    statistics = [each for each in await node.statistics() if "/robot" in each.entry.nodes]
    assert [each.statistics for each in statistics] == [None]
    robot.engine.close()
    await until_seen(node, lambda entries: not robots(entries))
