import asyncio

import srvgen
import taskrpc

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def pick(request, response):
    print(f"picks item {request.a}")
    return response


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_service(AddTwoInts, "pick", pick)
        await node.spin()


asyncio.run(main())
