import asyncio

from std_srvs.srv import SetBool, Trigger

import taskrpc

is_taken = False


def is_free(request, response):
    response.success = not is_taken
    return response


def take(request, response):
    global is_taken
    is_taken = request.data
    response.success = True
    return response


async def main():
    async with taskrpc.Node("cell") as node:
        node.create_service(Trigger, "is_free", is_free)
        node.create_service(SetBool, "take", take)
        await node.spin()


asyncio.run(main())
