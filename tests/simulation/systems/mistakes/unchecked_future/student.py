import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc


async def main():
    async with taskrpc.Node("student") as node:
        client = node.create_client(AddTwoInts, "water", timeout=3.0)
        await client.wait_for_service()
        futures = []
        for plant in range(4):
            future = client.call_async(AddTwoInts.Request(a=plant))
            future.add_done_callback(lambda _, plant=plant: print(f"plant {plant} is watered"))
            futures.append(future)
        await asyncio.wait(futures)
        print("ready")


asyncio.run(main())
