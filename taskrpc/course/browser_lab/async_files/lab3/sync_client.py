"""Lab 3, asynchronous: three calls, one after another."""

import time

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
PAIRS = @PAIRS@


async def main():
    async with taskrpc.Node("sync_client") as node:
        client = node.create_client(AddTwoInts, "@SERVICE@")
        await client.wait_for_service()
        began = time.monotonic()
        for a, b in PAIRS:
            request = AddTwoInts.Request(a=a, b=b)
            # 1. Call the service, and wait for the response: response = await client.call(request)
            # 2. Print the numbers and the sum: f"{a} + {b} = {response.sum}"
        print(f"the calls one after another took {time.monotonic() - began:.1f} s")


taskrpc.run(main())
