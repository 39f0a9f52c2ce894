"""The transports that run the contract suite, and what each of them lacks.

A new transport needs one line in `CASES`. Its name in the ids of the tests is that of the case.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from typing import Any, NamedTuple

from taskrpc.program import fast_loop
from taskrpc.testing import VirtualTimeLoop


class Case(NamedTuple):
    """One way to run the contract suite."""

    transport: str
    """The value of `transport=`."""
    loop: type[asyncio.AbstractEventLoop]
    opener: str = ""
    """Registers the transport for the tests; "" if taskrpc itself does."""
    settings: Mapping[str, Any] = {}
    """Arguments of each node, unless the test gives others."""
    apart: str = "token"
    """The argument that gives a node an endpoint of its own; nodes with equal ones share one."""
    lacks: Mapping[str, str] = {}
    """Tests that must fail, with the reason; the name of a test, or a part of it before a `*`."""


MEMORY_ENGINE = "taskrpc.testing.memory_engine:open_network"
VIRTUAL, REAL = VirtualTimeLoop, asyncio.SelectorEventLoop

TUNNEL_LACKS: dict[str, str] = {}
NATIVE_LACKS: dict[str, str] = {}

CASES = {
    "memory": Case("memory", VIRTUAL),
    "tcp": Case("tcp", REAL),
    "tunnel": Case(
        "tunnel", VIRTUAL, MEMORY_ENGINE, {"token": "secret"}, "listen", TUNNEL_LACKS
    ),
    "native": Case("tunnel", VIRTUAL, MEMORY_ENGINE, {}, "listen", NATIVE_LACKS),
}
if (uvloop := fast_loop()) is not None:
    CASES["tcp on uvloop"] = Case("tcp", uvloop)

LOOPS = {name: type(f"Loop of {name}", (case.loop,), {}) for name, case in CASES.items()}
"""A class of event loops for each case, so that a test finds its case by its loop."""


def case_of(loop: type[asyncio.AbstractEventLoop]) -> str:
    """Return the name of the case whose class of event loops this is; "" for any other class."""
    return next((name for name, each in LOOPS.items() if each is loop), "")
