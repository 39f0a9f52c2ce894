"""A prepared interpreter refuses what it cannot simulate, in one line."""

import pytest

from taskrpc.simulation.interpreter import watchdog

pytestmark = pytest.mark.real_time


@pytest.mark.parametrize(
    ("what", "code"),
    [
        ("a socket", "import socket\nsocket.socket()"),
        ("a subprocess", "import subprocess\nsubprocess.run(['true'])"),
        ("a subprocess", "import os\nos.system('true')"),
        ("a signal", "import os, signal\nos.kill(os.getpid(), signal.SIGTERM)"),
        ("a signal", "import signal\nsignal.raise_signal(signal.SIGTERM)"),
        ("the keyboard", "print()\ninput()"),
    ],
)
def test_program_that_leaves_the_simulated_world_is_refused_with_its_line(simulated, what, code):
    refusal = simulated(a=code).refusal()
    assert refusal.startswith(f"a.py:2 of a uses {what}, which cannot be simulated; ")
    assert "\n" not in refusal


def test_refusal_in_a_thread_names_its_line(simulated):
    code = """
        import socket, threading, time
        def work():
            socket.create_server(("", 0))
        threading.Thread(target=work).start()
        time.sleep(1)
        """
    assert simulated(a=code).refusal().startswith("a.py:4 of a uses a socket")


def test_refusal_in_a_task_names_its_line(simulated):
    code = """
        import asyncio
        async def main():
            await asyncio.open_connection("127.0.0.1", 80)
        asyncio.run(main())
        """
    assert simulated(a=code).refusal().startswith("a.py:4 of a uses a socket")


def test_refusal_that_the_program_catches_is_still_told(simulated):
    code = """
        import socket
        try:
            socket.socket()
        except Exception:
            print("caught")
        """
    assert simulated(a=code).refusal().startswith("a.py:4 of a uses a socket")


def test_worker_simulates_on_after_a_refusal(simulated):
    assert simulated(a="import socket; socket.socket()").refusal()
    assert simulated(a="print('well')").run().lines["a"] == ["well"]


@pytest.mark.faults
def test_program_that_never_waits_fails_the_run_with_its_line(simulated):
    loaded = simulated(
        a="""
        print("begin")
        while True:
            pass
        """
    )
    failure = loaded.explain()
    assert failure.kind == "a never waits"
    assert failure.text.startswith(f"a ran for {watchdog.LIMIT:g} s without waiting for anything")
    assert 'a.py", line' in failure.text
    assert simulated(a="print('well')").run().lines["a"] == ["well"]
