import asyncio

import srvgen
import taskrpc

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")


async def drive(client, order):
    goal = await client.send_goal(Fibonacci.Goal(order=order))
    try:
        try:
            await goal.result(timeout=1.0)
        except taskrpc.DeadlineExceeded:
            await goal.cancel()
            await goal.result()
        print(f"{order} is done")
    except taskrpc.GoalCanceled:
        print(f"{order} is cancelled")


async def main():
    async with taskrpc.Node("student") as node:
        client = node.create_action_client(Fibonacci, "drive")
        await client.wait_for_server()
        for order in range(1, 6):
            await drive(client, order)


asyncio.run(main())
