"""A service that takes its time: each sum needs half a second."""

import asyncio
import sys
from typing import Any

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 0.5


async def slow_add(request: Any, response: Any) -> Any:
    await asyncio.sleep(SECONDS)  # stands for work; other requests are taken meanwhile
    response.sum = request.a + request.b
    return response


async def main() -> None:
    async with taskrpc.Node("slow_adder") as node:
        # concurrency: so many requests may be worked on at the same time (example 7).
        node.create_service(AddTwoInts, "slow_add", slow_add, concurrency=4)
        print("/slow_add is ready; Ctrl-C ends it")
        await node.spin()


if __name__ == "__main__":
    taskrpc.run(main())
