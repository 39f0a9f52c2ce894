import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc


async def main():
    async with taskrpc.Node("student") as node:
        client = node.create_client(AddTwoInts, "pour", timeout=5.0)
        for order in range(4):
            while True:
                try:
                    await client.call(AddTwoInts.Request(a=order))
                    break
                except taskrpc.TaskRpcError:
                    await asyncio.sleep(1.0)
            print(f"drinks order {order}")


asyncio.run(main())
