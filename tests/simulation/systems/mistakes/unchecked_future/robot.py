import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc


def water(request, response):
    print(f"waters plant {request.a}")
    return response


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_service(AddTwoInts, "water", water)
        await node.spin()


asyncio.run(main())
