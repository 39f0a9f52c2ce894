"""Blocking programs get the same responses and errors, from any thread, and never hang."""

import os
import subprocess
import sys
import threading
import time
from concurrent.futures import CancelledError, ThreadPoolExecutor, wait

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
    assert client.wait_for_service(timeout=60)
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


def test_deadline_ends_the_wait_while_the_callback_still_runs(node):
    release = threading.Event()

    def stuck(request, response):
        release.wait(300)
        return response

    node.create_service(AddTwoInts, "stuck", stuck)
    client = node.create_client(AddTwoInts, "stuck")
    assert client.wait_for_service(timeout=60)
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


def test_blocking_call_on_the_loops_thread_is_refused(node):
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
    assert client.wait_for_service(60)
    future = client.call_async(AddTwoInts.Request())
    while not future.cancel():
        pass
    with pytest.raises(CancelledError):
        future.result(60)
    if client.call_async(AddTwoInts.Request(), timeout=0.2).exception(5):
        assert cancelled.wait(60)


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
        [sys.executable, program], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n", "")


def test_ctrl_c_ends_spin_even_while_its_thread_holds_a_lock(tmp_path):
    program = tmp_path / "spins.py"
    program.write_text(
        "import _thread, sys, threading, taskrpc.sync\n"
        "pressed = []\n"
        "def press():\n"
        "    if not pressed:\n"
        "        pressed.append(True)\n"
        "        _thread.interrupt_main()\n"
        "def trace(frame, event, argument):\n"
        "    if frame.f_code is threading.Condition.wait.__code__:\n"
        "        lock = frame.f_locals['self']._lock\n"
        "        if type(lock) is type(threading.Lock()) and lock.locked():\n"
        "            press()\n"
        "    return trace\n"
        "with taskrpc.sync.Node('spins') as node:\n"
        "    threading.Timer(0.5, press).start()\n"
        "    sys.settrace(trace)\n"
        "    node.spin()\n"
        "    sys.settrace(None)\n"
        "print('ended')\n"
    )
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=20, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "ended\n", "")


def test_call_after_the_event_loop_has_stopped_is_refused(tmp_path):
    """A function of atexit runs after the loop has stopped: its calls get an error."""
    program = tmp_path / "ends.py"
    program.write_text(
        "import atexit, srvgen, taskrpc.sync\n"
        "T = srvgen.load('std_srvs/srv/Trigger')\n"
        "def last():\n"
        "    for attempt in (client.call, client.call_async):\n"
        "        try:\n"
        "            attempt(T.Request())\n"
        "        except taskrpc.WouldDeadlock as error:\n"
        "            print(error)\n"
        "atexit.register(last)\n"
        "node = taskrpc.sync.Node('ends')\n"
        "node.__enter__()\n"
        "node.create_service(T, 'done', lambda request, response: response)\n"
        "client = node.create_client(T, 'done')\n"
        "client.call(T.Request())\n"
    )
    done = subprocess.run(
        [sys.executable, program], capture_output=True, text=True, timeout=120, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.count("the program is ending") == 2


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system cannot fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_forked_process_gets_an_error_that_the_node_belongs_to_its_parent(node):
    client = node.create_client(AddTwoInts, "nobody")
    told, tell = os.pipe()
    if (child := os.fork()) == 0:
        problem = "none"
        try:
            client.call_async(AddTwoInts.Request())
        except taskrpc.WouldDeadlock as error:
            problem = str(error)
        os.write(tell, problem.encode())
        os._exit(0)
    os.waitpid(child, 0)
    os.close(tell)
    with open(told, "rb") as pipe:
        assert b"call_async(): this node belongs to the parent process" in pipe.read()


def test_waiting_thread_gets_an_error_when_its_server_ends():
    began, release = threading.Event(), threading.Event()

    def stuck(request, response):
        began.set()
        release.wait(300)
        return response

    with taskrpc.sync.Node("caller") as caller, taskrpc.sync.Node("server") as server:
        server.create_service(AddTwoInts, "stuck", stuck)
        client = caller.create_client(AddTwoInts, "stuck")
        assert client.wait_for_service(timeout=60)
        with ThreadPoolExecutor(1) as threads:
            waiting = threads.submit(client.call, AddTwoInts.Request(), timeout=30)
            assert began.wait(60)
            server.destroy()
            with pytest.raises(taskrpc.OutcomeUnknown):
                waiting.result(60)
            release.set()


def test_short_deadline_after_a_long_one_is_kept(node):
    release = threading.Event()

    def stuck(request, response):
        release.wait(300)
        return response

    node.create_service(AddTwoInts, "stuck", stuck, concurrency=2)
    client = node.create_client(AddTwoInts, "stuck")
    assert client.wait_for_service(timeout=60)
    with ThreadPoolExecutor(1) as threads:
        patient = threads.submit(client.call, AddTwoInts.Request(), timeout=30)
        began = time.monotonic()
        with pytest.raises(taskrpc.DeadlineExceeded):
            client.call(AddTwoInts.Request(), timeout=0.1)
        assert 0.1 <= time.monotonic() - began < 5
        release.set()
        patient.result(60)


def test_call_sent_while_its_service_moves_reaches_only_that_service():
    """A method id of one server names another service on the connection of another server."""
    reached = []

    def noting(name):
        def callback(request, response):
            reached.append(name)
            return response

        return callback

    with (
        taskrpc.sync.Node("old", token="old") as old,
        taskrpc.sync.Node("new", token="new") as new,
        taskrpc.sync.Node("caller", token="caller") as caller,
    ):
        moving = old.create_service(AddTwoInts, "moving", noting("old moving"))
        for node, name in ((old, "other"), (new, "third")):
            node.create_service(AddTwoInts, name, noting(name))
        clients = [caller.create_client(AddTwoInts, name) for name in ("moving", "other", "third")]
        for client in clients:
            assert client.wait_for_service(timeout=60)
            client.call(AddTwoInts.Request())
        reached.clear()
        channel = clients[0]._inner._channel
        encode = channel._encode

        def encode_late(request):
            if threading.current_thread() is threading.main_thread():
                old._loop.do(moving.destroy, "destroy()")
                new.create_service(AddTwoInts, "moving", noting("new moving"))
                assert clients[0].wait_for_service(timeout=60)
            return encode(request)

        channel._encode = encode_late
        clients[0].call(AddTwoInts.Request())
    assert reached == ["new moving"]


def test_wait_for_several_futures_ends_for_a_call_that_never_began(node):
    client = node.create_client(AddTwoInts, "nobody")
    node._loop.soon(lambda: time.sleep(0.05))
    future = client.call_async(AddTwoInts.Request())
    assert future.cancel()
    assert wait([future], timeout=60).done == {future}


def test_threads_answer_a_deferred_service(node):
    threads = ThreadPoolExecutor(4)
    answer = lambda call: call.reply(AddTwoInts.Response(sum=call.request.a))  # noqa: E731
    node.create_deferred_service(AddTwoInts, "add", lambda call: threads.submit(answer, call))
    client = node.create_client(AddTwoInts, "add")
    assert [client.call(AddTwoInts.Request(a=n)).sum for n in range(50)] == list(range(50))
    threads.shutdown()


def test_a_node_can_be_started_and_closed_without_with():
    node = taskrpc.sync.Node("notebook").start()
    try:
        node.create_service(AddTwoInts, "add", add)
        assert node.create_client(AddTwoInts, "add").call(AddTwoInts.Request(a=2, b=3)).sum == 5
    finally:
        node.close()
    node.close()
    with pytest.raises(taskrpc.TaskRpcError, match=r"has not started; write .* `node.start\(\)`"):
        node.create_client(AddTwoInts, "add")


def test_a_service_with_a_callback_of_other_parameters_is_not_offered():
    with (
        taskrpc.sync.Node("server", transport="memory") as node,
        pytest.raises(TypeError, match=r"a request, a response, got .*missing"),
    ):
        node.create_service(AddTwoInts, "add", lambda one, two, three: two)
