"""Introspection events of services, as in ROS 2."""

import asyncio
import time

import pytest

import srvgen
import taskrpc
from taskrpc import Account, Accounts, KinematicRobot, MemoryStore, Role, TaskServer, default_world
from taskrpc.core.introspection import gid_of
from tests.core.transport.helpers import Add, add, ask, outcome, until

RECEIVED, SENT = 1, 2
ADD_EVENTS = "add/_service_event"


@pytest.fixture
async def server():
    async with taskrpc.Node("server", transport="memory", token="server") as node:
        yield node


@pytest.fixture
async def listener():
    async with taskrpc.Node("listener", transport="memory", token="listener") as node:
        yield node


async def listening(listener, service):
    events = []
    subscription = listener.create_subscription(Add.Event, ADD_EVENTS, events.append, 100)
    await until(subscription.get_publisher_count)
    await asyncio.sleep(0.01)
    return events


def told(events):
    return [
        (
            each.info.event_type,
            [(one.a, one.b) for one in each.request],
            [r.sum for r in each.response],
        )
        for each in events
    ]


async def test_contents_are_the_messages_of_each_call(server, listener):
    service = server.create_service(Add, "add", add)
    server.configure_introspection(service, "contents")
    events = await listening(listener, service)
    client = listener.create_client(Add, "add")
    assert (await client.call(ask(2, 3))).sum == 5
    await client.call(ask(4, 5))
    await until(lambda: len(events) == 4)
    assert told(events) == [
        (RECEIVED, [(2, 3)], []),
        (SENT, [], [5]),
        (RECEIVED, [(4, 5)], []),
        (SENT, [], [9]),
    ]
    assert [each.info.sequence_number for each in events] == [1, 1, 2, 2]
    assert list(events[0].info.client_gid) == gid_of("/listener")
    assert abs(events[0].info.stamp.sec - time.time()) < 60


async def test_metadata_is_without_the_messages(server, listener):
    service = server.create_service(Add, "add", add)
    server.configure_introspection(service, "metadata")
    events = await listening(listener, service)
    await listener.create_client(Add, "add").call(ask(2, 3))
    await until(lambda: len(events) == 2)
    assert told(events) == [(RECEIVED, [], []), (SENT, [], [])]


async def test_a_call_that_fails_has_no_response(server, listener):
    async def refuse(request, response):
        raise taskrpc.HandlerError("ABORTED", "no")

    service = server.create_service(Add, "add", refuse)
    server.configure_introspection(service, "contents")
    events = await listening(listener, service)
    assert isinstance(
        await outcome(listener.create_client(Add, "add").call(ask(2, 3))), taskrpc.HandlerFailed
    )
    await asyncio.sleep(0.1)
    assert told(events) == [(RECEIVED, [(2, 3)], [])]


async def test_switching_introspection_does_not_affect_running_calls(server, listener):
    service = server.create_service(Add, "add", add)
    client = listener.create_client(Add, "add")
    seen = 0
    for state in ("off", "contents", "metadata", "off", "contents"):
        server.configure_introspection(service, state)
        events = []
        if state != "off":
            events = await listening(listener, service)
        answers = await asyncio.gather(*(client.call(ask(n, 1)) for n in range(10)))
        assert [each.sum for each in answers] == [n + 1 for n in range(10)]
        await asyncio.sleep(0.05)
        assert len(events) == (0 if state == "off" else 20)
        seen += len(events)
    service.destroy()
    await until(lambda: not server.status().topics["/add/_service_event"].subscriptions)
    assert seen == 60


async def test_switched_off_introspection_does_not_change_calls(server, listener):
    service = server.create_service(Add, "add", add)
    server.configure_introspection(service, "contents")
    server.configure_introspection(service, "off")
    await listener.create_client(Add, "add").call(ask(2, 3))
    (connection,) = server._transport._served
    (route,) = connection.routes.values()
    assert route.call.__name__ == "RemoteCall"
    entries = await listener.graph()
    assert not [each for entry in entries for each in entry.publishers]


async def test_repeated_switching_leaves_no_publisher(server):
    service = server.create_service(Add, "add", add)
    before = list(service.finished._callbacks)
    for state in ("contents", "metadata", "off") * 10:
        server.configure_introspection(service, state)
    assert service.finished._callbacks == before
    server.configure_introspection(service, "contents")
    service.destroy()
    await until(lambda: not server._introspection._publishers)


async def test_observer_of_the_node_gets_the_same_events(listener):
    class Counting(taskrpc.Observer):
        began = ended = 0

        def call_began(self, call):
            self.began += 1

        def call_ended(self, call, code, seconds):
            self.ended += 1

    counting = Counting()
    async with taskrpc.Node("server", transport="memory", observer=counting) as server:
        service = server.create_service(Add, "add", add)
        for state in ("contents", "off"):
            server.configure_introspection(service, state)
            await listener.create_client(Add, "add").call(ask(2, 3))
    assert (counting.began, counting.ended) == (2, 2)


async def test_submit_role_cannot_subscribe_to_service_events(caplog):
    accounts = Accounts(
        [
            Account("looker", "0123456789abcdef0123", Role.SUBMIT),
            Account("boss", "0123456789abcdef0124", Role.OPERATE),
        ]
    )
    async with (
        taskrpc.Node("server", transport="memory", accounts=accounts) as server,
        taskrpc.Node("a", transport="memory", token="looker.0123456789abcdef0123") as looker,
        taskrpc.Node("b", transport="memory", token="boss.0123456789abcdef0124") as boss,
    ):
        service = server.create_service(Add, "add", add)
        server.configure_introspection(service, "contents")
        seen, all_seen = [], []
        looker.create_subscription(Add.Event, ADD_EVENTS, seen.append)
        boss.create_subscription(Add.Event, ADD_EVENTS, all_seen.append)
        await until(lambda: caplog.messages)
        await boss.create_client(Add, "add").call(ask(2, 3))
        await until(lambda: len(all_seen) == 2)
    assert not seen
    assert "/add/_service_event needs the role operate" in caplog.text


async def test_unknown_introspection_state_is_refused(server):
    service = server.create_service(Add, "add", add)
    with pytest.raises(ValueError, match="expected 'off', 'metadata' or 'contents', got 'on'"):
        server.configure_introspection(service, "on")


async def test_an_event_that_grows_too_large_is_missing_and_the_call_is_answered(server, listener):
    text = srvgen.load("my_robot_interfaces/srv/RobotTask")

    def echo(request, response):
        response.message = request.target
        return response

    service = server.create_service(text, "text", echo)
    server.configure_introspection(service, "contents")
    events = []
    listener.create_subscription(text.Event, "text/_service_event", events.append, 10)
    client = listener.create_client(text, "text")
    await until(lambda: server.status().topics["/text/_service_event"].subscriptions)
    size = 16 * 1024 * 1024 + 65_536 - 30
    answer = await client.call(text.Request(target="x" * size))
    assert len(answer.message) == size


async def test_task_server_publishes_events_of_all_services_on_request(server, listener):
    task = srvgen.load("my_robot_interfaces/srv/RobotTask")
    robot = KinematicRobot(default_world())
    async with TaskServer(server, robot, MemoryStore(), introspection="contents"):
        events = []
        subscription = listener.create_subscription(
            task.Event, "robot_task/_service_event", events.append, 10
        )
        await until(subscription.get_publisher_count)
        await asyncio.sleep(0.01)
        client = listener.create_client(task, "robot_task")
        answer = await client.call(task.Request(task_type="report", target="dock", priority=3))
        await until(lambda: len(events) == 2)
        assert events[0].request[0].task_type == "report"
        assert events[1].response[0].task_id == answer.task_id
        topics = {each.name for entry in await listener.graph() for each in entry.publishers}
        assert "/robot_task/cancel/_service_event" in topics


async def test_switching_introspection_keeps_the_service_visible(server, monkeypatch):
    service = server.create_service(Add, "add", add)
    changes = []
    network = server._transport.network
    publish = network.publish

    def noted(tracked, change, *, claim=""):
        changes.append(change.service)
        publish(tracked, change, claim=claim)

    monkeypatch.setattr(network, "publish", noted)
    for state in ("contents", "metadata", "off"):
        server.configure_introspection(service, state)
    assert changes
    assert not any(changes)
