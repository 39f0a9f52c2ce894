"""An action server: computes Fibonacci numbers, one after the other: python server.py [SECONDS]."""

import asyncio
import sys
from typing import Any

import srvgen
import taskrpc

Fibonacci = srvgen.load("example_interfaces/action/Fibonacci")

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 0.5
LONGEST = 20


def accept(request: Any) -> bool:
    if request.order > LONGEST:
        problem = f"at most {LONGEST} numbers, not {request.order}"
        raise taskrpc.HandlerError("OUT_OF_RANGE", problem)
    return True


async def compute(goal: Any) -> Any:
    print(f"goal {goal.request.order} begins")
    sequence = [0, 1]
    while len(sequence) <= goal.request.order:
        if goal.is_cancel_requested:
            print(f"goal {goal.request.order} is cancelled")
            return goal.canceled(Fibonacci.Result(sequence=sequence))
        sequence.append(sequence[-1] + sequence[-2])
        goal.publish_feedback(Fibonacci.Feedback(sequence=sequence))
        await asyncio.sleep(SECONDS)
    print(f"goal {goal.request.order} is done")
    return Fibonacci.Result(sequence=sequence)


async def main() -> None:
    async with taskrpc.Node("fibonacci_server") as node:
        node.create_action_server(Fibonacci, "fibonacci", compute, goal=accept)
        print("/fibonacci is ready; Ctrl-C ends it")
        await node.spin()


if __name__ == "__main__":
    taskrpc.run(main())
