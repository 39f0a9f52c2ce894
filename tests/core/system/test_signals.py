"""Stop signals reach every block that waits for them, and processes that are to end."""

import os
import signal
import subprocess
import sys
import threading

import pytest

from taskrpc.core.system import signals

posix = pytest.mark.skipif(os.name != "posix", reason="modes and owners are POSIX's")


@posix
def test_a_stop_signal_reaches_every_block_and_the_handlers_come_back():
    before = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
    one, other = [], []
    with signals.stop_signals(one.append):
        with signals.stop_signals(other.append):
            signal.raise_signal(signal.SIGTERM)
        signal.raise_signal(signal.SIGINT)
    assert one == [signal.SIGTERM, signal.SIGINT]
    assert other == [signal.SIGTERM]
    assert before == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]


@posix
def test_blocks_may_end_in_any_order():
    one, other = [], []
    before = signal.getsignal(signal.SIGTERM)
    first, second = signals.stop_signals(one.append), signals.stop_signals(other.append)
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    signal.raise_signal(signal.SIGTERM)
    second.__exit__(None, None, None)
    assert (one, other) == ([], [signal.SIGTERM])
    assert signal.getsignal(signal.SIGTERM) is before


def test_outside_the_main_thread_signals_stay_as_they_are():
    before = signal.getsignal(signal.SIGTERM)
    seen = []

    def run():
        with signals.stop_signals(seen.append):
            seen.append(signal.getsignal(signal.SIGTERM))

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    assert seen == [before]


@pytest.mark.real_time
def test_a_process_can_be_asked_to_end():
    with subprocess.Popen([sys.executable, "-c", "import time; time.sleep(60)"]) as sleeping:
        signals.end_process(sleeping.pid)
        assert sleeping.wait(60) != 0
    ended_pid = sleeping.pid if os.name == "posix" else 0x7FFF_FFFC
    with pytest.raises(ProcessLookupError):
        signals.end_process(ended_pid)
