import asyncio

import srvgen
import taskrpc

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")

inside = ""


def take(request, response):
    global inside
    if inside in ("", request.target):
        inside = request.target
        response.success = True
    return response


def leave(request, response):
    global inside
    if inside == request.target:
        inside = ""
    response.success = True
    return response


async def main():
    async with taskrpc.Node("cell") as node:
        node.create_service(RobotTask, "take_cell", take, idempotent=True)
        node.create_service(RobotTask, "leave_cell", leave, idempotent=True)
        await node.spin()


asyncio.run(main())
