import asyncio

from example_interfaces.srv import AddTwoInts

import taskrpc


class Robot:
    def __init__(self, node):
        self.note = node.create_client(AddTwoInts, "note")
        self.is_noted = node.create_client(AddTwoInts, "is_noted")
        node.create_service(AddTwoInts, "pour", self.pour)

    async def pour(self, request, response):
        if not (await self.is_noted.call(AddTwoInts.Request(a=request.a))).sum:
            print(f"pours order {request.a}")
            await self.note.call(AddTwoInts.Request(a=request.a))
        return response


async def main():
    async with taskrpc.Node("robot") as node:
        Robot(node)
        await node.spin()


asyncio.run(main())
