import asyncio

import srvgen
import taskrpc

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")


async def main():
    async with taskrpc.Node("student") as node:
        client = node.create_action_client(Fibonacci, "drive")
        await client.wait_for_server()
        for order in range(1, 5):
            goal = await client.send_goal(Fibonacci.Goal(order=order))
            try:
                await goal.result(timeout=1.0)
                print(f"{order} is done")
            except taskrpc.DeadlineExceeded:
                await goal.cancel()
                print(f"{order} is cancelled")


asyncio.run(main())
