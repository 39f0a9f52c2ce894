"""Two slow services: one that may come too late, and one that looks at the clock."""

import asyncio
import sys
from typing import Any

import srvgen
import taskrpc

Trigger = srvgen.load("std_srvs/srv/Trigger")

SECONDS = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0


async def scan(request: Any, response: Any) -> Any:
    call = taskrpc.current_call()  # what is known about the call that we answer
    print(f"call {call.number}: the caller waits {call.time_left():.1f} s, we need {SECONDS} s")
    try:
        await asyncio.sleep(SECONDS)  # stands for the turning laser
    except asyncio.CancelledError:
        # The caller's time is up. Tidy up (stop the motor), then let the cancellation go on.
        print(f"call {call.number}: cancelled, the caller waits no longer")
        raise
    print(f"call {call.number}: done")
    response.success, response.message = True, "the whole scan"
    return response


async def quick_scan(request: Any, response: Any) -> Any:
    # A poor answer in time is often better than a good one too late.
    time_left = taskrpc.current_call().time_left() or SECONDS
    seconds = min(SECONDS, time_left / 2)
    await asyncio.sleep(seconds)
    response.success, response.message = True, f"{seconds / SECONDS:.2f} of the scan"
    return response


async def main() -> None:
    async with taskrpc.Node("scanner") as node:
        node.create_service(Trigger, "scan", scan)
        node.create_service(Trigger, "quick_scan", quick_scan)
        print("/scan and /quick_scan are ready; Ctrl-C ends them")
        await node.spin()


if __name__ == "__main__":
    taskrpc.run(main())
