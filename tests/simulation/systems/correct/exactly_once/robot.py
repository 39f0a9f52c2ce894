import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc


def pick(request, response):
    print(f"picks item {request.a}")
    return response


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_service(AddTwoInts, "pick", pick, exactly_once=taskrpc.MemoryCompletions())
        await node.spin()


asyncio.run(main())
