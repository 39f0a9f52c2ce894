"""Accelerated time, in a process of its own."""

import json
import subprocess
import sys

import pytest

pytestmark = [pytest.mark.labs, pytest.mark.real_time]

PROGRAM = """
import json
from taskrpc.course.labs.sandbox import speed
speed.install()
import asyncio, queue, select, socket, threading, time
from time import monotonic

def lock():
    one = threading.Lock()
    one.acquire()
    one.acquire(timeout=2)

def rlock():
    one = threading.RLock()
    with one:
        other = threading.Thread(target=lambda: one.acquire(timeout=2))
        other.start()
        other.join()

def condition():
    one = threading.Condition()
    with one:
        one.wait_for(lambda: False, 2)

def empty(one):
    try:
        one.get(timeout=2)
    except queue.Empty:
        pass

def join():
    threading.Thread(target=threading.Event().wait, args=(30,), daemon=True).start()
    threading.enumerate()[-1].join(2)

WAYS = {
    "sleep": lambda: time.sleep(2),
    "event": lambda: threading.Event().wait(2),
    "lock": lock,
    "rlock": rlock,
    "condition": condition,
    "queue": lambda: empty(queue.Queue()),
    "simple queue": lambda: empty(queue.SimpleQueue()),
    "join": join,
    "select": lambda: select.select([], [], [], 2),
    "asyncio": lambda: asyncio.run(asyncio.sleep(2)),
}
speed.set_speed(20)
found = {}
for name, way in WAYS.items():
    real, seen = speed.real_monotonic(), [time.time(), monotonic(), time.perf_counter_ns() / 1e9]
    way()
    after = [time.time(), time.monotonic(), time.perf_counter_ns() / 1e9]
    found[name] = speed.real_monotonic() - real, [b - a for a, b in zip(seen, after)]
print(json.dumps(found))
"""


def test_waits_and_clocks_agree_and_are_faster_than_real_time():
    # `real_monotonic` is read through its module: names in a program get the faster clock.
    output = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, check=True)
    found = json.loads(output.stdout)
    for name, (real, seen) in found.items():
        assert min(seen) >= 1.99, name
        # No statement about the upper limit: the machine may be busy. But both clocks agree.
        assert all(abs(each - 20 * real) < 0.1 * each + 0.5 for each in seen), name
