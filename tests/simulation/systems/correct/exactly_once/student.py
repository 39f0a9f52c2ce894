import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc


async def main():
    retry = taskrpc.RetryPolicy(attempt_timeout=1.0)
    async with taskrpc.Node("student") as node:
        client = node.create_client(AddTwoInts, "pick", timeout=60.0, retry=retry)
        await client.wait_for_service()
        for item in range(5):
            await client.call(AddTwoInts.Request(a=item), request_id=f"item {item}")
            print(f"has item {item}")


asyncio.run(main())
