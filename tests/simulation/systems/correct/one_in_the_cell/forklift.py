import asyncio
import random
import sys

import srvgen
import taskrpc

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")
name = sys.argv[1]


async def main():
    retry = taskrpc.RetryPolicy(attempt_timeout=0.5)
    async with taskrpc.Node(name) as node:
        take = node.create_client(RobotTask, "take_cell", timeout=30.0, retry=retry)
        leave = node.create_client(RobotTask, "leave_cell", timeout=30.0, retry=retry)
        await take.wait_for_service()
        request = RobotTask.Request(target=name)
        for _ in range(3):
            await asyncio.sleep(random.uniform(0.5, 2.0))
            while not (await take.call(request)).success:
                await asyncio.sleep(0.1)
            print("enters")
            await asyncio.sleep(0.5)
            print("leaves")
            await leave.call(request)


asyncio.run(main())
