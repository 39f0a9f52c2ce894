"""Races of an exactly-once service: every order of the few steps involved, forced one by one."""

import asyncio
import logging
import time

import pytest

from taskrpc.core.callinfo import current_call
from taskrpc.core.exactly_once import Effect
from taskrpc.core.request_ids.ids import Completion, ReceivedId, StoredCompletions
from taskrpc.core.security.roles import Role
from taskrpc.core.transport.base import IncomingCall
from taskrpc.core.transport.codec import codec_of
from taskrpc.errors import OutcomeUnknown, StoreError, TaskRpcError
from taskrpc.service import Service
from tests.core.transport.helpers import Add

TURNS = (0, 1, 2, 20)
"""Turns of the loop between two steps: from none at all to as many as everything needs."""


def interleavings(*threads):
    """Every order of steps in which those of each thread keep their own order."""
    if not any(threads):
        yield ()
    for number, thread in enumerate(threads):
        if thread:
            rest = (*threads[:number], thread[1:], *threads[number + 1 :])
            yield from ((thread[0], *order) for order in interleavings(*rest))


async def turns(count):
    for _ in range(count):
        await asyncio.sleep(0)


class FakeTransport:
    def offer(self, offer):
        self.serve = offer.serve

    def withdraw(self, offer):
        pass


class Call(IncomingCall, eq=False, kw_only=True):
    """One sending of a request; `ends` is what its caller was told."""

    ends: list

    def reply(self, response, body=None):
        self.ends.append(response.sum)

    def fail(self, error):
        if not self.ends:
            self.ends.append(error)

    def leave(self):
        self.cancel()
        self.fail(TaskRpcError("cancelled by the caller"))


def sending(client, *, counts=True):
    """A sending of the one request of a client, "x" or "y"; without a number it does not count."""
    loop = asyncio.get_running_loop()
    received = ReceivedId(client.encode() * 16, 1, 1, client.encode()) if counts else None
    request = Add.Request(a=ord(client), b=0)
    who = "/x", "/me", "", Role.ADMIN, 1, None, loop.time
    return Call(*who, request=request, received_id=received, arrived=loop.time(), ends=[])


class Store:
    """A store whose every step waits until `do` lets it happen; `effects` is what it has applied.

    `fails` has the effects whose first change fails with an unknown outcome, and whether the store
    has applied them.
    """

    def __init__(self, **fails):
        self._steps = {}
        self._fails = fails
        self._kept = []
        self._readings = 0
        self.effects = []
        self.do("read 0", "returned 0")

    def do(self, *names):
        for name in names:
            self._step(name).set()

    def _step(self, name):
        return self._steps.setdefault(name, asyncio.Event())

    async def recall(self):
        number, self._readings = self._readings, self._readings + 1
        await self._step(f"read {number}").wait()
        remembered = StoredCompletions(b"S" * 16, tuple(self._kept))
        await self._step(f"returned {number}").wait()
        return remembered

    async def complete(self, completion, effect, forgotten=()):
        await self._step(f"write {effect}").wait()
        fails, is_stored = effect in self._fails, self._fails.pop(effect, True)
        if is_stored:
            self.effects.append(effect)
            if completion is not None:
                self._kept.append(completion)
        await self._step(f"written {effect}").wait()
        if fails:
            raise OutcomeUnknown("the disk did not say")


class Scene:
    """An exactly-once service before a `Store`, without a network."""

    def __init__(self, store, callback):
        self.store, self._transport = store, FakeTransport()
        self._service = Service(self._transport, Add, "/x", "/server", callback, store=store)

    def send(self, client, *, counts=True):
        call = sending(client, counts=counts)
        self._transport.serve(call)
        return call

    async def close(self):
        self._service.destroy()
        await turns(20)


async def add(request, response):
    response.sum = request.a
    return Effect(response, chr(request.a))


@pytest.fixture(autouse=True)
def quiet():
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


async def perform(scene, order, pause):
    """Do the steps in this order; returns the calls that were sent."""
    sent = []
    for step in order:
        if step.startswith("send"):
            sent.append(scene.send(step[-1]))
        else:
            scene.store.do(step)
        await turns(pause)
    await turns(50)
    return sent


@pytest.mark.parametrize("x_is_stored", [True, False])
@pytest.mark.parametrize("pause", TURNS)
async def test_request_stored_while_the_store_is_read_again_never_runs_again(pause, x_is_stored):
    reading, storing = ("read 1", "returned 1"), ("write y", "written y")
    for order in interleavings(reading, storing, ("send y",), ("send x",)):
        scene = Scene(Store(x=x_is_stored), add)
        await turns(20)
        x, y = await perform(scene, ("send x", "send y", "write x", "written x"), 20)
        assert isinstance(x.ends[0], OutcomeUnknown), order  # so the store is read anew
        again = await perform(scene, order, pause)
        again += await perform(scene, ("send x", "send y"), 20)
        assert sorted(scene.store.effects) == ["x", "y"], order
        assert y.ends == [ord("y")], order
        assert all(call.ends == [call.request.a] for call in again), order
        await scene.close()


@pytest.mark.parametrize("y_is_stored", [True, False])
@pytest.mark.parametrize("pause", TURNS)
async def test_request_missing_in_an_older_reading_never_runs_again(pause, y_is_stored):
    first, second = ("read 1", "returned 1"), ("write y", "written y", "read 2", "returned 2")
    for order in interleavings(first, second, ("send y",)):
        scene = Scene(Store(x=True, y=y_is_stored), add)
        await turns(20)
        await perform(scene, ("send y", "send x", "write x", "written x"), 20)
        again = await perform(scene, order, pause)
        again += await perform(scene, ("send y", "send x"), 20)
        assert sorted(scene.store.effects) == ["x", "y"], order
        # The repeated call may have attached to the execution whose outcome was unknown.
        assert [call.ends for call in again[1:]] == [[ord("y")], [ord("x")]], order
        assert len(again[0].ends) == 1, order
        await scene.close()


class Handler:
    """A callback that stores its own effect, as the task server's does, or leaves that to us."""

    def __init__(self, store, *, stores_itself):
        self._store, self._stores_itself = store, stores_itself
        self.was_cancelled = False
        self.ready = asyncio.Event()
        self.call = None

    async def __call__(self, request, response):
        await self.ready.wait()
        self.call = current_call()
        response.sum = request.a
        if not self._stores_itself:
            return Effect(response, chr(request.a))
        completion = self.call.completed_by(response)
        storing = asyncio.ensure_future(self._store.complete(completion, chr(request.a)))
        try:
            await asyncio.shield(storing)  # who stops waiting does not stop it
        except asyncio.CancelledError:
            self.was_cancelled = True
            raise
        return response


@pytest.mark.parametrize("stores_itself", [True, False])
@pytest.mark.parametrize("pause", TURNS)
async def test_disconnecting_caller_never_causes_a_second_execution(pause, stores_itself):
    storing = ("ready", "write y", "written y")
    for order in interleavings(storing, ("leave",), ("repeat",)):
        store = Store()
        handler = Handler(store, stores_itself=stores_itself)
        scene = Scene(store, handler)
        await turns(20)
        first, repeated = scene.send("y"), None
        await turns(20)
        for step in order:
            if step == "leave":
                first.leave()
            elif step == "repeat":
                repeated = scene.send("y")
            elif step == "ready":
                handler.ready.set()
            else:
                store.do(step)
            await turns(pause)
        await turns(50)
        assert store.effects == ["y"], order
        assert repeated.ends == [ord("y")], order
        assert len(first.ends) == 1, order
        await scene.close()


@pytest.mark.parametrize("stores_itself", [True, False])
@pytest.mark.parametrize("counts", [True, False])
async def test_a_call_is_not_cancelled_once_its_effect_is_being_stored(counts, stores_itself):
    store = Store()
    handler = Handler(store, stores_itself=stores_itself)
    scene = Scene(store, handler)
    await turns(20)
    call = scene.send("y", counts=counts)
    handler.ready.set()
    await turns(20)
    call.leave()
    await turns(20)
    assert not handler.call.cancelled
    store.do("write y", "written y")
    await turns(20)
    assert store.effects == ["y"]
    assert not handler.was_cancelled
    await scene.close()


class SharedStore(Store):
    """A store that other servers use at the same time."""

    def __init__(self, *known, problem=None):
        super().__init__()
        self._known, self.problem = known, problem
        self.asked = []

    async def look_up(self, client):
        self.asked.append(client)
        await asyncio.sleep(0)
        if self.problem is not None:
            raise self.problem
        return list(self._known)


def done_elsewhere(client):
    name = client.encode()
    body = codec_of(Add.Response).encode(Add.Response(sum=42))
    return Completion("", name * 16, 1, 1, name, body, 0, time.time())


async def test_request_that_another_server_has_completed_gets_its_response():
    store = SharedStore(done_elsewhere("x"))
    scene = Scene(store, add)
    x, y = scene.send("x"), scene.send("y")
    store.do("write y", "written y")
    await turns(20)
    assert (x.ends, y.ends) == ([42], [ord("y")])
    assert store.effects == ["y"]
    assert [client for _, client in store.asked] == [b"x" * 16, b"y" * 16]
    await scene.close()


async def test_request_does_not_run_if_it_cannot_be_looked_up():
    store = SharedStore(problem=StoreError("the database is away"))
    scene = Scene(store, add)
    call = scene.send("x")
    await turns(20)
    [error] = call.ends
    assert (str(error), error.not_executed) == ("the database is away", True)
    assert store.effects == []
    await scene.close()


async def test_outage_of_the_store_is_logged_once_not_for_each_request(caplog):
    logging.disable(logging.NOTSET)
    store = SharedStore(problem=StoreError("the database is away"))
    scene = Scene(store, add)
    for client in "xyz":
        scene.send(client)
        await turns(20)
    assert caplog.text.count("cannot look requests up: the database is away") == 1
    store.problem = None
    scene.send("a")
    await turns(20)
    store.problem = StoreError("the database is away")
    scene.send("b")
    await turns(20)
    assert caplog.text.count("cannot look requests up: the database is away") == 2
    store.do("write a", "written a")
    await turns(20)
    await scene.close()
