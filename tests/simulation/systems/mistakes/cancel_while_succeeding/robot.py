import asyncio

import srvgen
import taskrpc

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")


async def drive(goal):
    for _ in range(9):
        if goal.is_cancel_requested:
            return goal.canceled(Fibonacci.Result())
        await asyncio.sleep(0.1)
    print(f"arrives at {goal.request.order}")
    return Fibonacci.Result()


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_action_server(Fibonacci, "drive", drive)
        await node.spin()


asyncio.run(main())
