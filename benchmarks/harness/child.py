"""One side of one contender, as a process: `python -m benchmarks.harness.child ROLE NAME`.

ROLE is `server`, `client` or `idle`. Commands come as lines of JSON on the standard input, each is
answered by one line on the standard output; the process ends with its input. What is imported here
is part of every contender's start-up time: little.
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import json
import os
import sys
import threading
from collections.abc import Callable
from typing import Any

from benchmarks.contenders import contender
from benchmarks.harness.contender import Contender
from benchmarks.harness.limits import open_files

_GRACE = 2.0
"""Seconds that a server has to clean up: some wait for clients that stay connected."""


def main(role: str, name: str) -> None:
    """Run one role until the standard input ends."""
    chosen = contender(name)
    if chosen.loop == "asyncio":
        # taskrpc.sync takes uvloop by itself wherever it can be imported.
        sys.modules["uvloop"] = None  # type: ignore[assignment]
    open_files()
    {"server": _serve, "client": _client, "idle": _idle}[role](chosen)


def _serve(chosen: Contender) -> None:
    module, options = chosen.load(), list(chosen.options)
    helpers: list[int] = []

    def announce(place: str, *pids: int) -> None:
        helpers.extend(pids)
        _answer({"place": place, "helpers": pids})

    if not inspect.iscoroutinefunction(module.serve):
        threading.Thread(target=_report_usage, args=[helpers, _end], daemon=True).start()
        module.serve(announce, options)
        return

    async def serve() -> None:
        task = asyncio.ensure_future(module.serve(announce, options))
        loop = asyncio.get_running_loop()

        def end() -> None:
            task.cancel()
            loop.call_later(_GRACE, _end)

        ended = lambda: loop.call_soon_threadsafe(end)  # noqa: E731
        threading.Thread(target=_report_usage, args=[helpers, ended], daemon=True).start()
        with contextlib.suppress(asyncio.CancelledError):
            await task

    _run(chosen, serve())
    _end()


def _report_usage(helpers: list[int], at_end: Callable[[], object]) -> None:
    from benchmarks.harness import usage

    for _ in sys.stdin:
        _answer({"cpu": usage.cpu_time(helpers), "memory": usage.memory()})
    at_end()


def _client(chosen: Contender) -> None:
    from benchmarks.harness.load import Load

    module, options = chosen.load(), list(chosen.options)
    _answer({"ready": True})

    async def connected(place: str) -> Load:
        if inspect.iscoroutinefunction(module.connect):
            load = Load(await module.connect(place, options), None)
        else:
            further = None if chosen.shared else lambda: module.connect(place, options)
            load = Load(module.connect(place, options), further)
        await load.check(typed=chosen.typed)
        _answer({"connected": True})
        return load

    async def client() -> None:
        loads = []
        while command := await _command():
            if "place" in command:  # earlier ones are kept: some complain when they are dropped
                loads.append(await connected(command["place"]))
            else:
                _answer(await loads[-1].run(**command))
        _end()

    _run(chosen, client())


def _idle(chosen: Contender) -> None:
    from benchmarks.harness.idlers import hold_idle

    async def idle() -> None:
        await hold_idle(chosen.load(), _command, _answer)
        _end()

    _run(chosen, idle())


def _run(chosen: Contender, main: Any) -> None:
    factory = None
    if chosen.loop == "uvloop":
        import uvloop

        factory = uvloop.new_event_loop
    with asyncio.Runner(loop_factory=factory) as runner:
        runner.run(main)


async def _command() -> Any:
    """The next command; None at the end. Read in a thread, because connections stay alive."""
    line = await asyncio.to_thread(sys.stdin.readline)
    return json.loads(line) if line else None


def _answer(answer: Any) -> None:
    print(json.dumps(answer), flush=True)


def _end() -> None:
    """Leave at once: libraries would wait for their threads, or complain of open connections."""
    os._exit(0)


if __name__ == "__main__":
    main(*sys.argv[1:])
