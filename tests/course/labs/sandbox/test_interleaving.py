"""Callbacks that take turns at each step: a missing lock always shows."""

import sys
import threading

import pytest

from taskrpc.course.labs.sandbox.interleaving import Tracer

pytestmark = pytest.mark.real_time
UNSAFE = "counter['ids'] = counter['ids'] + 1"
PROGRAMS = {
    "in one statement": f"def callback(counter, lock):\n    {UNSAFE}\n",
    "in a function that it calls": (
        f"def next_id(counter):\n    {UNSAFE}\ndef callback(counter, lock):\n    next_id(counter)\n"
    ),
}
SAFE = f"def callback(counter, lock):\n    with lock:\n        {UNSAFE}\n"


def ids_after(folder, text, threads=2):
    """Run the callback of a program in threads at the same time; returns the last id."""
    names = {}
    exec(compile(text, "server.py", "exec"), names)
    tracer, counter, lock = Tracer(folder), {"ids": 0}, threading.Lock()

    def run():
        sys.settrace(tracer.called)
        try:
            names["callback"](counter, lock)
        finally:
            sys.settrace(None)

    running = [threading.Thread(target=run) for _ in range(threads)]
    for each in running:
        each.start()
    for each in running:
        each.join()
    return counter["ids"]


@pytest.mark.parametrize("text", PROGRAMS.values(), ids=PROGRAMS)
def test_two_threads_without_a_lock_get_the_same_id(text, tmp_path):
    assert ids_after(tmp_path, text) == 1


def test_threads_with_a_lock_get_ids_of_their_own(tmp_path):
    assert ids_after(tmp_path, SAFE, threads=3) == 3


def test_a_single_thread_goes_on_alone(tmp_path):
    assert ids_after(tmp_path, PROGRAMS["in one statement"], threads=1) == 1
