"""How long `call_async` + `spin_until_future_complete` take, beside a raw asyncio echo.

    python -m benchmarks.rclpy_latency [--rounds N] [--calls N] [--cores N]

Client and server are two processes, on one core unless `--cores 0`: on two, the wake-ups of a
virtual machine decide. The rounds of both alternate; what counts is the ratio in each, of which
the median is printed.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import os
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from benchmarks.contenders import raw_asyncio

IN_FLIGHT = 64
MOST_LATENCY, MOST_AT_64 = 3.0, 10.0
"""What the layer promises, as multiples of the raw echo."""

_SERVICE = "add_two_ints"


def serve_raw() -> None:
    async def main() -> None:
        server = await asyncio.get_running_loop().create_server(raw_asyncio.Server, "127.0.0.1", 0)
        print(server.sockets[0].getsockname()[1], flush=True)
        await server.serve_forever()

    asyncio.run(main())


def serve_rclpy() -> None:
    from taskrpc.ros.packages import rclpy

    with rclpy.init(args=[]):
        node = rclpy.create_node("latency_server")

        def add(request: Any, response: Any) -> Any:
            response.sum = request.a + request.b
            return response

        node.create_service(_add_two_ints(), _SERVICE, add)
        print("ready", flush=True)
        rclpy.spin(node)


def _add_two_ints() -> Any:
    import srvgen

    return srvgen.load("example_interfaces/srv/AddTwoInts")


@contextlib.contextmanager
def server(kind: str) -> Iterator[str]:
    """A server in a process of its own, and what it says at its start."""
    command = [sys.executable, "-m", "benchmarks.rclpy_latency", "--serve", kind]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        try:
            yield process.stdout.readline().strip()
        finally:
            process.kill()


Measure = Callable[[int], tuple[float, float]]
"""Makes so many calls; seconds a call, one after another and with many in flight."""


@contextlib.contextmanager
def raw() -> Iterator[Measure]:
    with server("raw") as port, asyncio.Runner() as runner:

        async def connect() -> raw_asyncio.Client:
            loop = asyncio.get_running_loop()
            created = await loop.create_connection(raw_asyncio.Client, "127.0.0.1", int(port))
            return created[1]

        caller = runner.run(connect())
        body = bytes(16)

        async def one_by_one(calls: int) -> float:
            times = []
            for _ in range(calls):
                began = time.perf_counter()
                await caller.call(body)
                times.append(time.perf_counter() - began)
            return statistics.median(times)

        async def together(calls: int) -> float:
            began = time.perf_counter()
            for _ in range(calls // IN_FLIGHT):
                await asyncio.gather(*[caller.call(body) for _ in range(IN_FLIGHT)])
            return (time.perf_counter() - began) / (calls // IN_FLIGHT * IN_FLIGHT)

        yield lambda calls: (runner.run(one_by_one(calls)), runner.run(together(calls)))


@contextlib.contextmanager
def layer() -> Iterator[Measure]:
    from taskrpc.ros.packages import rclpy

    srv_type = _add_two_ints()
    with server("rclpy"), rclpy.init(args=[]):
        node = rclpy.create_node("latency_client")
        client = node.create_client(srv_type, _SERVICE)
        assert client.wait_for_service(10.0), "the server did not come"

        def one_by_one(calls: int) -> float:
            times = []
            for number in range(calls):
                began = time.perf_counter()
                future = client.call_async(srv_type.Request(a=number, b=1))
                rclpy.spin_until_future_complete(node, future)
                times.append(time.perf_counter() - began)
                assert future.result().sum == number + 1
            return statistics.median(times)

        def together(calls: int) -> float:
            began = time.perf_counter()
            for _ in range(calls // IN_FLIGHT):
                futures = [client.call_async(srv_type.Request(a=1, b=1)) for _ in range(IN_FLIGHT)]
                for future in futures:
                    rclpy.spin_until_future_complete(node, future)
            return (time.perf_counter() - began) / (calls // IN_FLIGHT * IN_FLIGHT)

        yield lambda calls: (one_by_one(calls), together(calls))


def pin(cores: int) -> None:
    """Keep this process and its children on so many cores, where the system can; 0 for all."""
    if cores and hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, sorted(os.sched_getaffinity(0))[:cores])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--calls", type=int, default=2048)
    parser.add_argument("--cores", type=int, default=1)
    parser.add_argument("--serve", choices=("raw", "rclpy"), help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.serve:
        serve_raw() if given.serve == "raw" else serve_rclpy()
        return
    pin(given.cores)
    os.environ["ROS_DOMAIN_ID"] = str(os.getpid() % 200)  # others may measure at the same time
    ratios: list[tuple[float, float]] = []
    with raw() as measure_raw, layer() as measure_layer:
        measure_raw(IN_FLIGHT), measure_layer(IN_FLIGHT)
        for _ in range(given.rounds):
            (raw_one, raw_many), (one, many) = measure_raw(given.calls), measure_layer(given.calls)
            ratios.append((one / raw_one, many / raw_many))
            print(
                f"one by one {one * 1e6:6.1f} µs, raw {raw_one * 1e6:5.1f} µs, x{one / raw_one:.2f}"
                f"   {IN_FLIGHT} in flight {many * 1e6:6.1f} µs a call, raw {raw_many * 1e6:5.1f},"
                f" x{many / raw_many:.2f}"
            )
    latency, at_64 = (statistics.median(each) for each in zip(*ratios, strict=True))
    print(f"latency x{latency:.2f} (at most {MOST_LATENCY:g})")
    print(f"{IN_FLIGHT} in flight x{at_64:.2f} (at most {MOST_AT_64:g})")


if __name__ == "__main__":
    main()
