import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc

noted = set()


def note(request, response):
    noted.add(request.a)
    return response


def is_noted(request, response):
    response.sum = int(request.a in noted)
    return response


async def main():
    async with taskrpc.Node("store") as node:
        node.create_service(AddTwoInts, "note", note)
        node.create_service(AddTwoInts, "is_noted", is_noted)
        await node.spin()


asyncio.run(main())
