"""Four calls at once: the program goes on while the server works."""

import asyncio
import sys
import time
from typing import Any

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def on_response(future: asyncio.Future[Any]) -> None:
    if future.exception() is None:
        print(f"callback: a sum is here, {future.result().sum}")


async def main() -> None:
    async with taskrpc.Node("async_client") as node:
        client = node.create_client(AddTwoInts, "slow_add")
        began = time.monotonic()
        futures = []
        for n in range(1, 5):
            # Sends the request and comes back at once, with a promise of the response.
            future = client.call_async(AddTwoInts.Request(a=n, b=n))
            future.add_done_callback(on_response)
            futures.append(future)
        print(f"four requests sent after {time.monotonic() - began:.2f} s")
        for step in range(1, 4):
            print(f"meanwhile: other work, step {step}")
            await asyncio.sleep(0.05)  # where a program awaits, callbacks get their turn
        try:
            responses = await asyncio.gather(*futures)  # now we do need all four
        except taskrpc.TaskRpcError as error:
            sys.exit(f"a call failed: {error}")
        print(f"all sums: {[response.sum for response in responses]}")
        print(f"four calls together took {time.monotonic() - began:.2f} s")


if __name__ == "__main__":
    taskrpc.run(main())
