"""Everybody who takes part: one module each, of which some take part several times.

Each makes AddTwoInts in the way that its users would, with the least that it offers, and an echo of
bytes. Where a library leaves the encoding to its user, the two integers travel as a `struct`, which
nothing beats.
"""

from __future__ import annotations

from benchmarks.harness.contender import Contender

_LOOPS = (("", "asyncio"), (", uvloop", "uvloop"))


def _on_both_loops(name: str, module: str, *options: str, **more: object) -> list[Contender]:
    return [
        Contender(name + suffix, module, loop=loop, options=options, **more)  # type: ignore[arg-type]
        for suffix, loop in _LOOPS
    ]


BASELINE = Contender("raw asyncio", "raw_asyncio", typed=False, idle=True)
"""What all others are compared with."""

CONTENDERS: tuple[Contender, ...] = (
    BASELINE,
    Contender("raw asyncio, uvloop", "raw_asyncio", loop="uvloop", typed=False, idle=True),
    Contender("raw asyncio, large first", "raw_asyncio", options=("large-first",), typed=False),
    Contender("raw blocking socket", "raw_socket", typed=False, most_in_flight=64),
    *_on_both_loops("ideal RPC", "ideal", needs=("msgspec",), distribution="msgspec"),
    *_on_both_loops("taskrpc", "taskrpc_tcp", distribution="taskrpc", idle=True),
    *_on_both_loops("taskrpc async", "taskrpc_tcp", "async", distribution="taskrpc"),
    *_on_both_loops("taskrpc exactly once", "taskrpc_tcp", "once", distribution="taskrpc"),
    *_on_both_loops(
        "taskrpc.sync", "taskrpc_sync", distribution="taskrpc", most_in_flight=64, shared=True
    ),
    *_on_both_loops("taskrpc memory", "taskrpc_memory", distribution="taskrpc", one_process=True),
    Contender("grpc.aio", "grpc_aio", needs=("grpc",), distribution="grpcio"),
    Contender("aiohttp, JSON", "aiohttp_json", needs=("aiohttp",), distribution="aiohttp"),
    Contender(
        "nats-py", "nats_py", needs=("nats",), programs=("nats-server",), distribution="nats-py"
    ),
    Contender("pyzmq", "pyzmq", needs=("zmq",), distribution="pyzmq"),
    Contender("Pyro5", "pyro5", needs=("Pyro5",), distribution="Pyro5", most_in_flight=64),
    Contender("rpyc", "rpyc_threads", needs=("rpyc",), most_in_flight=64, distribution="rpyc"),
    Contender(
        "zenoh",
        "zenoh_queryable",
        needs=("zenoh",),
        distribution="eclipse-zenoh",
        most_in_flight=64,
        shared=True,
    ),
)


def contender(name: str) -> Contender:
    """The contender of this name; raises KeyError where there is none."""
    return {each.name: each for each in CONTENDERS}[name]
