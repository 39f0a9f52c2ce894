"""Threads for callbacks run as many jobs at a time as allowed, and hold up no program's end."""

import gc
import subprocess
import sys
import threading
import time
import weakref

import pytest

from taskrpc.core.execution.daemon_threads import DaemonThreads

pytestmark = pytest.mark.real_time

BLOCKED = """
import asyncio, time
import srvgen, taskrpc
Add = srvgen.load("example_interfaces/srv/AddTwoInts")

def stuck(request, response):
    print("begun", flush=True)
    time.sleep(60)

async def main():
    async with (
        taskrpc.Node("server", transport="memory", token="s") as server,
        taskrpc.Node("client", transport="memory", token="c") as node,
    ):
        server.create_service(Add, "stuck", stuck, threaded=True)
        client = node.create_client(Add, "stuck")
        try:
            await client.call(Add.Request(), timeout=0.5)
        except taskrpc.DeadlineExceeded:
            print("ended")

asyncio.run(main())
"""


def test_jobs_run_in_order_and_no_more_at_a_time_than_allowed():
    threads = DaemonThreads(3, "test")
    running, most, order = [], [], []

    def work(number):
        order.append(number)
        running.append(number)
        most.append(len(running))
        time.sleep(0.005)
        running.remove(number)
        return number

    jobs = [threads.submit(work, number) for number in range(30)]
    assert [each.result(60) for each in jobs] == list(range(30))
    assert max(most) == 3
    assert sorted(order) == list(range(30))
    threads.shutdown()


def test_an_idle_thread_is_used_again():
    threads = DaemonThreads(8, "test")
    names = set()
    for _ in range(20):
        names.add(threads.submit(lambda: threading.current_thread().name).result(60))
        time.sleep(0.002)
    assert len(names) <= 2
    threads.shutdown()


def test_an_error_is_the_jobs_own():
    threads = DaemonThreads(1, "test")
    assert isinstance(threads.submit(int, "x").exception(5), ValueError)
    assert isinstance(threads.submit(sys.exit, 3).exception(5), SystemExit)
    assert threads.submit(int, "4").result(60) == 4
    threads.shutdown()


def test_a_cancelled_job_does_not_run_and_a_done_one_is_not_kept():
    threads = DaemonThreads(1, "test")
    gate = threading.Event()
    first, second = threads.submit(gate.wait), threads.submit(gate.clear)
    assert second.cancel()
    gate.set()
    assert first.result(60)
    assert threads.submit(gate.is_set).result(60)

    class Large:
        pass

    large = Large()
    kept = weakref.ref(large)
    threads.submit(id, large).result(60)
    del large
    time.sleep(0.01)
    gc.collect()
    assert kept() is None
    threads.shutdown()


def test_a_callback_that_blocks_does_not_hold_up_the_programs_end():
    began = time.monotonic()
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stdout.split() == ["begun", "ended"], done.stderr
    assert done.returncode == 0
    assert time.monotonic() - began < 20
