"""Eight requests at the same time, to each service: python client.py [SERVICE ...]."""

import asyncio
import sys
import time

import srvgen
import taskrpc

Trigger = srvgen.load("std_srvs/srv/Trigger")

SERVICES = sys.argv[1:] or ["one_by_one", "eight_at_once", "threads"]


async def time_eight_calls(node: taskrpc.Node, service: str) -> float:
    client = node.create_client(Trigger, service)
    began = time.monotonic()
    # gather: start all of them, go on when the last one is done.
    await asyncio.gather(*[client.call(Trigger.Request()) for _ in range(8)])
    return time.monotonic() - began


async def main() -> None:
    async with taskrpc.Node("many_requests") as node:
        for service in SERVICES:
            try:
                seconds = await time_eight_calls(node, service)
            except taskrpc.TaskRpcError as error:
                sys.exit(f"the call failed: {error}")
            print(f"/{service}: 8 requests in {seconds:.2f} s")


if __name__ == "__main__":
    taskrpc.run(main())
