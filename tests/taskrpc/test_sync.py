"""Blocking programs get the same answers and errors, from any thread, and never hang."""

import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError, ThreadPoolExecutor

import pytest

import srvgen
import taskrpc
import taskrpc.sync

pytestmark = pytest.mark.real_time

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    response.sum = request.a + request.b
    return response


@pytest.fixture
def node():
    with taskrpc.sync.Node("blocking") as node:
        yield node


def test_a_call_blocks_until_the_response_is_there(node):
    node.create_service(AddTwoInts, "add", add)
    client = node.create_client(AddTwoInts, "add")
    assert client.wait_for_service(timeout=5)
    assert client.call(AddTwoInts.Request(a=2, b=3)).sum == 5


def test_many_threads_may_share_one_client(node):
    node.create_service(AddTwoInts, "add", add, concurrency=4)
    client = node.create_client(AddTwoInts, "add")
    with ThreadPoolExecutor(8) as threads:
        sums = threads.map(lambda n: client.call(AddTwoInts.Request(a=n, b=n)).sum, range(200))
        assert list(sums) == [2 * n for n in range(200)]


def test_errors_are_those_of_the_async_client(node):
    def refuse(request, response):
        raise taskrpc.HandlerError("NOT_FOUND", "no such thing")

    node.create_service(AddTwoInts, "refuse", refuse)
    with pytest.raises(taskrpc.HandlerFailed, match="no such thing"):
        node.create_client(AddTwoInts, "refuse").call(AddTwoInts.Request())
    with pytest.raises(taskrpc.ServiceUnavailable):
        node.create_client(AddTwoInts, "nobody").call(AddTwoInts.Request())
    with pytest.raises(taskrpc.InvalidRequest, match="a: expected int64"):
        node.create_client(AddTwoInts, "refuse").call(AddTwoInts.Request(a="x"))


def test_a_deadline_ends_the_wait_although_the_callback_goes_on(node):
    release = threading.Event()

    def stuck(request, response):
        release.wait(10)
        return response

    node.create_service(AddTwoInts, "stuck", stuck)
    client = node.create_client(AddTwoInts, "stuck")
    with pytest.raises(taskrpc.DeadlineExceeded):
        client.call(AddTwoInts.Request(), timeout=0.05)
    release.set()


def test_a_callback_may_call_another_service(node):
    node.create_service(AddTwoInts, "add", add)
    inner = node.create_client(AddTwoInts, "add")

    def twice(request, response):
        response.sum = 2 * inner.call(request).sum
        return response

    node.create_service(AddTwoInts, "twice", twice)
    assert node.create_client(AddTwoInts, "twice").call(AddTwoInts.Request(a=1, b=2)).sum == 6


def test_a_blocking_call_on_the_loops_own_thread_is_an_error_and_not_a_deadlock(node):
    node.create_service(AddTwoInts, "add", add)
    inner = node.create_client(AddTwoInts, "add")
    seen = []

    async def deadlock(request, response):
        for attempt in (lambda: inner.call(request), inner.wait_for_service, node.graph):
            with pytest.raises(taskrpc.WouldDeadlock) as caught:
                attempt()
            seen.append(str(caught.value))
        return response

    node.create_service(AddTwoInts, "deadlock", deadlock)
    node.create_client(AddTwoInts, "deadlock").call(AddTwoInts.Request())
    assert len(seen) == 3
    assert "would wait for ever" in seen[0]


def test_cancelling_the_future_cancels_the_call(node):
    cancelled = threading.Event()

    def patient(request, response):
        while not taskrpc.current_call().cancelled:
            time.sleep(0.001)
        cancelled.set()
        return response

    node.create_service(AddTwoInts, "patient", patient)
    client = node.create_client(AddTwoInts, "patient")
    assert client.wait_for_service(5)
    future = client.call_async(AddTwoInts.Request())
    while not future.cancel():
        pass
    with pytest.raises(CancelledError):
        future.result(5)
    if client.call_async(AddTwoInts.Request(), timeout=0.2).exception(5):
        assert cancelled.wait(5)


def test_ctrl_c_reaches_a_program_that_waits(tmp_path):
    program = tmp_path / "waits.py"
    program.write_text(
        "import _thread, threading, srvgen, taskrpc.sync\n"
        "T = srvgen.load('std_srvs/srv/Trigger')\n"
        "with taskrpc.sync.Node('waits') as node:\n"
        "    client = node.create_client(T, 'nobody')\n"
        "    threading.Timer(0.3, _thread.interrupt_main).start()\n"
        "    try:\n"
        "        client.wait_for_service()\n"
        "    except KeyboardInterrupt:\n"
        "        print('interrupted')\n"
    )
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=30, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")
