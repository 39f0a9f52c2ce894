import asyncio
import random

from std_srvs.srv import Trigger

import taskrpc


async def carry(request, response):
    print("closes the gripper")
    await asyncio.sleep(random.uniform(0.5, 0.95))
    print("opens the gripper")
    response.success = True
    return response


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_service(Trigger, "carry", carry)
        await node.spin()


asyncio.run(main())
