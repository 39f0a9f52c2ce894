"""Sends a goal: python client.py [ORDER [NUMBERS]]; cancels it after NUMBERS numbers, 3 or more."""

import sys

import srvgen
import taskrpc

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")

ORDER = int(sys.argv[1]) if len(sys.argv) > 1 else 5
ENOUGH = int(sys.argv[2]) if len(sys.argv) > 2 else None


async def main() -> None:
    async with taskrpc.Node("fibonacci_client") as node:
        client = node.create_action_client(Fibonacci, "fibonacci")
        if not await client.wait_for_server(timeout=2.0):
            sys.exit("/fibonacci is not available: start server.py first")
        try:
            # The handle comes when the server has accepted the goal, long before it is done.
            handle = await client.send_goal(Fibonacci.Goal(order=ORDER))
            print("the goal was accepted")
            async for feedback in handle.feedback:
                numbers = list(feedback.sequence)
                print(f"so far: {numbers}")
                if len(numbers) == ENOUGH:
                    print(f"cancelling: {'accepted' if await handle.cancel() else 'refused'}")
            result = await handle.result()
        except taskrpc.GoalRejected as error:
            sys.exit(f"the goal was rejected: {error}")
        except taskrpc.GoalCanceled as error:
            sys.exit(f"the goal was cancelled after {list(error.result.sequence)}")
        except taskrpc.TaskRpcError as error:
            sys.exit(f"the goal failed: {error}")
        print(f"the result: {list(result.sequence)}")


if __name__ == "__main__":
    taskrpc.run(main())
