"""The latency of service calls on ROS 2, beside plain rclpy.

    python benchmarks/ros_latency.py [--calls N] [--rounds N]

It needs an environment with the real rclpy. Two servers run in processes of their own: a plain
rclpy node, and a taskrpc program on `transport="ros"`. In each round, the clients call in turn, so
that all see the same load of the machine:

- plain: a plain rclpy client calls the plain server;
- to ROS: a taskrpc client calls the plain server;
- from ROS: the plain client calls the taskrpc server natively;
- tunnel: a taskrpc client calls the taskrpc server.

The result is the median of each, and the median of the ratios of the rounds to plain.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import statistics
import subprocess
import sys
import time
from collections.abc import Callable

import srvgen
import taskrpc

TRIGGER = srvgen.load("std_srvs/srv/Trigger")
PLAIN, OURS = "/plain_trigger", "/taskrpc_trigger"


def plain_server() -> None:
    """Serve with rclpy alone."""
    import rclpy
    from std_srvs.srv import Trigger

    rclpy.init()
    node = rclpy.create_node("plain_server")
    node.create_service(Trigger, PLAIN, lambda _, response: response)
    print("ready", flush=True)
    rclpy.spin(node)


async def our_server() -> None:
    """Serve with taskrpc on ROS 2."""
    async with taskrpc.Node("taskrpc_server", transport="ros") as node:
        node.create_service(TRIGGER, OURS, lambda _, response: response)
        print("ready", flush=True)
        await node.spin()


def plain_client(calls: int) -> Callable[[str], float]:
    """Return a function that calls a service with rclpy; it returns the median in seconds."""
    import rclpy
    from std_srvs.srv import Trigger

    rclpy.init()
    node = rclpy.create_node("plain_client")
    clients = {name: node.create_client(Trigger, name) for name in (PLAIN, OURS)}
    for client in clients.values():
        assert client.wait_for_service(20), "no server"

    def measure(name: str) -> float:
        seconds = []
        for _ in range(calls):
            began = time.perf_counter()
            future = clients[name].call_async(Trigger.Request())
            rclpy.spin_until_future_complete(node, future)
            seconds.append(time.perf_counter() - began)
        return statistics.median(seconds)

    return measure


async def measured(calls: int, rounds: int) -> dict[str, float]:
    """Return the medians in microseconds, and the ratios."""
    plain = plain_client(calls)
    results: dict[str, list[float]] = {"plain": [], "from ROS": [], "to ROS": [], "tunnel": []}
    async with taskrpc.Node("taskrpc_client", transport="ros") as node:
        clients = {name: node.create_client(TRIGGER, name) for name in (PLAIN, OURS)}
        for client in clients.values():
            assert await client.wait_for_service(20), "no server"

        async def ours(name: str) -> float:
            seconds = []
            for _ in range(calls):
                began = time.perf_counter()
                await clients[name].call(TRIGGER.Request())
                seconds.append(time.perf_counter() - began)
            return statistics.median(seconds)

        await ours(OURS), await ours(PLAIN)
        for _ in range(rounds):
            results["plain"].append(await asyncio.to_thread(plain, PLAIN))
            results["from ROS"].append(await asyncio.to_thread(plain, OURS))
            results["to ROS"].append(await ours(PLAIN))
            results["tunnel"].append(await ours(OURS))
    found = {f"{name}, µs": statistics.median(each) * 1e6 for name, each in results.items()}
    for name in ("from ROS", "to ROS", "tunnel"):
        pairs = zip(results[name], results["plain"], strict=True)
        found[f"{name} / plain"] = statistics.median(one / other for one, other in pairs)
    return {name: round(value, 2) for name, value in found.items()}


def main() -> None:
    """Run a server, or start both and measure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--calls", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=9)
    parser.add_argument("--serve", choices=["plain", "ours"], help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve == "plain":
        plain_server()
    elif options.serve == "ours":
        asyncio.run(our_server())
    else:
        servers = []
        try:
            for which in ("plain", "ours"):
                command = [sys.executable, __file__, "--serve", which]
                servers.append(subprocess.Popen(command, stdout=subprocess.PIPE))
                assert servers[-1].stdout is not None
                servers[-1].stdout.readline()
            print(json.dumps(asyncio.run(measured(options.calls, options.rounds)), indent=2))
        finally:
            for server in servers:
                server.kill()


if __name__ == "__main__":
    main()
