import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc

lights = set()


def switch(request, response):
    lights.add(request.a)
    print(f"switches light {request.a}")
    return response


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_service(AddTwoInts, "switch_on", switch, idempotent=True)
        await node.spin()


asyncio.run(main())
