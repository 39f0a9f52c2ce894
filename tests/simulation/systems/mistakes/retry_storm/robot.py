import asyncio
import time

from std_srvs.srv import Trigger

import taskrpc

started = time.monotonic()


def dock(request, response):
    if time.monotonic() - started < 0.4:
        raise taskrpc.HandlerError("FAILED_PRECONDITION", "the sensors are still warming up")
    print("docks")
    response.success = True
    return response


async def main():
    async with taskrpc.Node("robot") as node:
        node.create_service(Trigger, "dock", dock)
        await node.spin()


asyncio.run(main())
