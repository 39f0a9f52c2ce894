"""The watchdog counts processor time: a busy machine ends no program."""

from __future__ import annotations

import pytest

from taskrpc.simulation.interpreter import watchdog

TICKS = 20


class Ended(Exception):
    """The watchdog has looked often enough."""


def watch(monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """Watch a program that never waits; the machine gives it a share of its processor."""
    now = 0.0

    def sleep(seconds: float) -> None:
        nonlocal now
        now += seconds
        if now > TICKS:
            raise Ended

    monkeypatch.setattr(watchdog, "_sleep", sleep)
    monkeypatch.setattr(watchdog, "_cpu_seconds", lambda: now * share)
    monkeypatch.setattr(watchdog, "_start", lambda run, arguments: run(*arguments))
    watchdog.watch(lambda: 1)


def test_program_that_computes_without_waiting_is_ended(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(watchdog.NeverWaits):
        watch(monkeypatch, share=1.0)


def test_program_that_gets_little_of_the_processor_goes_on(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(Ended):
        watch(monkeypatch, share=0.1)
