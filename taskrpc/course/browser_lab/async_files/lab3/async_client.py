"""Lab 3, asynchronous: three calls at the same time."""

import asyncio
import time

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
PAIRS = @PAIRS@


def tick():
    print("tick")


async def main():
    async with taskrpc.Node("async_client") as node:
        client = node.create_client(AddTwoInts, "@SERVICE@")
        await client.wait_for_service()
        node.create_timer(0.25, tick)
        began = time.monotonic()
        calls = [show(client, a, b) for a, b in PAIRS]
        # 5. Run all calls at the same time, until all are complete: await asyncio.gather(*calls)
        print(f"the calls at the same time took {time.monotonic() - began:.1f} s")


async def show(client, a, b):
    request = AddTwoInts.Request(a=a, b=b)
    # 3. Call the service, and wait for the response: response = await client.call(request)
    # 4. Print f"{a} + {b} = {...}"


taskrpc.run(main())
