"""Events of programs, and the matchers that choose programs."""

import signal
from types import SimpleNamespace

import pytest


def test_matchers_choose_programs(launch):
    process = launch.events.process
    details = {"name": "talker-1", "cmd": ["/bin/talker", "-x"], "pid": 5}
    action, other = SimpleNamespace(process_details=details), SimpleNamespace(process_details=None)
    for matcher in (
        process.matches_action(action),
        process.matches_pid(5),
        process.matches_name("talker-1"),
        process.matches_executable("talker"),
    ):
        assert matcher(action)
        assert not matcher(other)


def test_signal_has_number_and_name(launch):
    event = launch.events.process.SignalProcess
    assert event(signal_number="SIGINT", process_matcher=bool).signal == signal.SIGINT
    assert event(signal_number=signal.SIGTERM, process_matcher=bool).signal_name == "SIGTERM"
    assert event(signal_number="SIGKILL", process_matcher=bool).signal_name == "SIGKILL"
    with pytest.raises(ValueError, match="'SIGNOPE' is not a signal"):
        event(signal_number="SIGNOPE", process_matcher=bool)


def test_output_knows_its_stream(launch):
    details = {"action": None, "name": "a", "cmd": [], "cwd": None, "env": None, "pid": 1}
    out = launch.events.process.ProcessStdout(text=b"x", **details)
    assert (out.from_stdout, out.from_stderr, out.from_stdin) == (True, False, False)
    assert (out.text, out.pid, out.process_name) == (b"x", 1, "a")
