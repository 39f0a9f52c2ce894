import asyncio

from std_srvs.srv import Trigger

import taskrpc


async def main():
    async with taskrpc.Node("student") as node:
        client = node.create_client(Trigger, "carry", timeout=1.0)
        await client.wait_for_service()
        for number in range(4):
            try:
                await client.call(Trigger.Request())
                print(f"cup {number} is there")
            except taskrpc.DeadlineExceeded:
                print(f"cup {number} takes too long")


asyncio.run(main())
