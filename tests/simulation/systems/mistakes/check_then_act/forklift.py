import asyncio
import random
import sys

from std_srvs.srv import SetBool, Trigger

import taskrpc

name = sys.argv[1]


async def main():
    async with taskrpc.Node(name) as node:
        is_free = node.create_client(Trigger, "is_free")
        take = node.create_client(SetBool, "take")
        for _ in range(3):
            await asyncio.sleep(random.uniform(0.5, 2.0))
            while not (await is_free.call(Trigger.Request())).success:
                await asyncio.sleep(0.1)
            await take.call(SetBool.Request(data=True))
            print("enters")
            await asyncio.sleep(0.5)
            print("leaves")
            await take.call(SetBool.Request(data=False))


asyncio.run(main())
