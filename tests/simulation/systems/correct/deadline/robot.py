import asyncio
import random

from std_srvs.srv import Trigger

import taskrpc


async def carry(request, response):
    if taskrpc.current_call().time_left() < 0.5:
        response.message = "too late to begin"
        return response
    print("closes the gripper")
    try:
        await asyncio.sleep(random.uniform(0.5, 1.2))
    finally:
        print("opens the gripper")
    response.success = True
    return response


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_service(Trigger, "carry", carry, concurrency=1)
        await node.spin()


asyncio.run(main())
