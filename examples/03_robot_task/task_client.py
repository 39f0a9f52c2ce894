"""The lecture's client: sends four tasks at once and hears later whether they were accepted."""

import asyncio
import sys
from typing import Any

import srvgen
import taskrpc

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")

TASKS = [
    ("move", "warehouse", 8),
    ("scan", "area_a", 9),
    ("move", "station_1", 5),
    ("report", "central", 3),
]


def response_callback(future: asyncio.Future[Any]) -> None:
    # Called when a response has come, or an error instead.
    try:
        response = future.result()
    except taskrpc.TaskRpcError as error:
        print(f"Service call failed: {error}")
        return
    if response.success:
        eta = f"ETA: {response.estimated_time:.1f}s"
        print(f"Task accepted! ID: {response.task_id}, {eta} - {response.message}")
    else:
        print(f"Task rejected: {response.message}")


async def main() -> None:
    async with taskrpc.Node("task_client") as node:
        client = node.create_client(RobotTask, "robot_task")
        if not await client.wait_for_service(timeout=5.0):
            sys.exit("/robot_task is not available: start a task server first")
        futures = []
        for task_type, target, priority in TASKS:
            request = RobotTask.Request(task_type=task_type, target=target, priority=priority)
            future = client.call_async(request)  # sends and comes back at once
            future.add_done_callback(response_callback)
            futures.append(future)
        await asyncio.wait(futures)  # stay until all responses are here


if __name__ == "__main__":
    taskrpc.run(main())
