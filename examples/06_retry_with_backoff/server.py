"""A sensor that answers only every third time, and a motor that is slow to answer."""

import asyncio
from itertools import count
from typing import Any

import srvgen
import taskrpc

Trigger = srvgen.load("std_srvs/srv/Trigger")

readings = count(1)
metres_driven = 0


def read_sensor(request: Any, response: Any) -> Any:
    reading = next(readings)
    if reading % 3 != 0:
        print(f"reading {reading}: the sensor is not ready")
        # UNAVAILABLE promises that nothing was done, so the caller may safely try again.
        raise taskrpc.HandlerError("UNAVAILABLE", "the sensor is not ready")
    print(f"reading {reading}: 21.5 degrees")
    response.success, response.message = True, "21.5 degrees"
    return response


async def drive_one_metre(request: Any, response: Any) -> Any:
    global metres_driven
    metres_driven += 1
    print(f"the robot drives one metre; it is now at {metres_driven} m")
    await asyncio.sleep(1.0)  # it has moved, only the answer is late
    response.success = True
    return response


def get_position(request: Any, response: Any) -> Any:
    response.success, response.message = True, f"{metres_driven} m"
    return response


async def main() -> None:
    async with taskrpc.Node("flaky_robot") as node:
        # Reading twice does no harm. Driving twice does.
        node.create_service(Trigger, "read_sensor", read_sensor, idempotent=True)
        node.create_service(Trigger, "drive_one_metre", drive_one_metre)
        node.create_service(Trigger, "get_position", get_position)
        print("/read_sensor, /drive_one_metre and /get_position are ready; Ctrl-C ends them")
        await node.spin()


if __name__ == "__main__":
    taskrpc.run(main())
