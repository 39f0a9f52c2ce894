import asyncio

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


async def main():
    async with taskrpc.Node("student") as node:
        client = node.create_client(AddTwoInts, "pick", timeout=1.0)
        await client.wait_for_service()
        for item in range(5):
            for _ in range(3):
                try:
                    await client.call(AddTwoInts.Request(a=item))
                    print(f"has item {item}")
                    break
                except taskrpc.DeadlineExceeded:
                    print(f"orders item {item} again")


asyncio.run(main())
