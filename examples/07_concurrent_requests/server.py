"""The same work, offered in four ways; each request takes a quarter of a second."""

import asyncio
import sys
import time
from typing import Any

import srvgen
import taskrpc

Trigger = srvgen.load("std_srvs/srv/Trigger")

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 0.25


async def wait_async(request: Any, response: Any) -> Any:
    await asyncio.sleep(SECONDS)  # meanwhile others may run
    response.success = True
    return response


def wait_blocking(request: Any, response: Any) -> Any:
    time.sleep(SECONDS)  # blocks its thread, as a driver's library or a long computation does
    response.success = True
    return response


async def main() -> None:
    async with taskrpc.Node("worker") as node:
        # One at a time is what you get unless you ask: nothing can happen in between.
        node.create_service(Trigger, "one_by_one", wait_async)
        node.create_service(Trigger, "eight_at_once", wait_async, concurrency=8)
        node.create_service(Trigger, "threads", wait_blocking, concurrency=8, threaded=True)
        # A mistake: concurrency does not help a function that never lets go.
        node.create_service(Trigger, "holding", wait_blocking, concurrency=8)
        print("/one_by_one, /eight_at_once, /threads and /holding are ready; Ctrl-C ends them")
        await node.spin()


if __name__ == "__main__":
    taskrpc.run(main())
