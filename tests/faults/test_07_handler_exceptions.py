"""Promise 7: each exception in a callback reaches the caller at once, without internals."""

import asyncio
import builtins
import configparser
import logging
import socket
import sqlite3
import struct
import subprocess
import zipfile

import pytest

import taskrpc
from taskrpc import service
from taskrpc.core.transport import pipe
from taskrpc.errors import Code, HandlerFailed
from tests.core.transport.helpers import Add, ask
from tests.faults.harness import Bug

pytestmark = pytest.mark.faults

CANARY = "canary-7f3a"
ENDS_THE_PROGRAM = (SystemExit, KeyboardInterrupt)


class Unprintable(Exception):
    def __str__(self):
        raise RuntimeError(CANARY)

    __repr__ = __str__


class Falsy(Exception):
    def __bool__(self):
        return False


class Own(BaseException):
    """A BaseException that is not an Exception."""


def made(kind):
    """An exception of this type that contains the canary."""
    if issubclass(kind, BaseExceptionGroup):
        return kind(CANARY, [ValueError(CANARY)])
    for arguments in (
        (CANARY,),
        (CANARY, CANARY),
        ("utf-8", b"canary", 0, 1, CANARY),
        ("utf-8", 0, 1, CANARY),
        (),
    ):
        try:
            return kind(*arguments)
        except TypeError:
            continue
    raise AssertionError(f"{kind} could not be made")


def kinds():
    places = (builtins, sqlite3, asyncio, configparser, struct, socket, zipfile, subprocess)
    named = [each for place in places for each in vars(place).values()]
    found = [each for each in named if isinstance(each, type)]
    errors = {each for each in found if issubclass(each, BaseException)} - {*ENDS_THE_PROGRAM}
    own = {each for each in vars(taskrpc.errors).values() if isinstance(each, type)}
    own = {each for each in own if issubclass(each, taskrpc.TaskRpcError)}
    more = {asyncio.CancelledError, asyncio.InvalidStateError, Unprintable, Falsy, Own}
    ready = errors | own | more
    # These errors carry a message for the caller on purpose.
    ready -= {taskrpc.HandlerError, taskrpc.HandlerFailed, taskrpc.InvalidName}
    ready = {each for each in ready if not each.__name__.startswith("_")}
    return sorted(ready, key=lambda each: each.__name__)


class Raising:
    """Callbacks of three kinds that raise the error whose number is in the request."""

    def __init__(self):
        self.kinds = kinds()

    def plain(self, request, response):
        if request.a < 0:
            return response
        raise made(self.kinds[request.a])

    async def at_once(self, request, response):
        return self.plain(request, response)

    async def later(self, request, response):
        await asyncio.sleep(0.001)
        return self.plain(request, response)


def told_too_much(patch):
    def answer(call, error):
        call.fail(HandlerFailed(Code.INTERNAL, f"the handler failed: {CANARY if error else error}"))

    patch(service, "answer_unexpected", answer)


def told_nothing(patch):
    patch(service, "answer_unexpected", lambda call, error: None)


@pytest.mark.planted(Bug(told_too_much, "leaks"), Bug(told_nothing, "not at once"))
async def test_each_handler_exception_is_answered_at_once_and_leaks_nothing(
    counts, monkeypatch, caplog
):
    caplog.set_level(logging.CRITICAL + 1)
    raising, sent = Raising(), []
    write = pipe.Pipe.write
    monkeypatch.setattr(
        pipe.Pipe, "write", lambda pipe, data: sent.append(bytes(data)) or write(pipe, data)
    )
    loop = asyncio.get_running_loop()
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        ways = {"plain": {}, "at_once": {}, "later": {}, "plain_threaded": {"threaded": True}}
        for way, options in ways.items():
            callback = getattr(raising, way.removesuffix("_threaded"))
            server.create_service(Add, way, callback, **options)
            client = node.create_client(Add, way, timeout=1)
            assert await client.wait_for_service(5)
            for number in range(len(raising.kinds)):
                began = loop.time()
                try:
                    await client.call(ask(number))
                    counts["answered as if nothing was"] += 1
                except HandlerFailed as error:
                    counts["leaks"] += CANARY in f"{error!r} {error} {vars(error)}"
                    counts["wrong verdict"] += error.not_executed is not False
                except taskrpc.TaskRpcError:
                    counts["wrong type"] += 1
                counts["not at once"] += loop.time() - began > 0.1
                counts["raised"] += 1
            # The service still works.
            await client.call(ask(-1))
    counts["leaks"] += sum(CANARY.encode() in data for data in sent)
    counts["types"] = len(raising.kinds)
    counts["bytes seen"] = sum(map(len, sent))
    counts.check(
        "leaks",
        "not at once",
        "answered as if nothing was",
        "wrong verdict",
        "wrong type",
        happened=("raised", "bytes seen"),
    )
    assert len(raising.kinds) >= 100
