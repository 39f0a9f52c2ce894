"""The lecture's task server, small: a priority queue and one worker that empties it."""

import asyncio
import sys
from typing import Any

import srvgen
import taskrpc

RobotTask = srvgen.load("my_robot_interfaces/srv/RobotTask")

SECONDS = {"move": 5.0, "scan": 3.0, "report": 1.0}
SPEED = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0


class TaskServer:
    """Takes tasks, and works them off one at a time, the most urgent first."""

    def __init__(self) -> None:
        # Smallest first, so the priority goes in negated; the id keeps equals in their order.
        self.queue: asyncio.PriorityQueue[tuple[int, int, Any]] = asyncio.PriorityQueue()
        self.task_counter = 0

    def handle_task_request(self, request: Any, response: Any) -> Any:
        """Queue a task and respond at once; the client does not wait for the robot."""
        if request.task_type not in SECONDS:
            response.success = False
            response.message = f"Invalid task: {request.task_type}; use {', '.join(SECONDS)}"
            response.task_id = -1
            return response
        self.task_counter += 1
        self.queue.put_nowait((-request.priority, self.task_counter, request))
        response.success = True
        response.message = f"Task queued: {request.task_type}"
        response.task_id = self.task_counter
        response.estimated_time = SECONDS[request.task_type] / SPEED
        print(
            f"Task {self.task_counter} queued: {request.task_type} to {request.target}"
            f" (priority: {request.priority})"
        )
        return response

    async def process_tasks(self) -> None:
        """Work, for ever; runs beside the service."""
        while True:
            # Looking ten times a second lets tasks that come together be put in order first.
            await asyncio.sleep(0.1)
            while not self.queue.empty():
                _, task_id, task = self.queue.get_nowait()
                print(f"Executing task {task_id}: {task.task_type} - {task.target}")
                # `await` lets requests be answered meanwhile; time.sleep would stop everything.
                await asyncio.sleep(SECONDS[task.task_type] / SPEED)
                print(f"Task {task_id} completed")


async def main() -> None:
    server = TaskServer()
    async with taskrpc.Node("task_management_server") as node:
        node.create_service(RobotTask, "robot_task", server.handle_task_request)
        worker = asyncio.create_task(server.process_tasks())
        print("Task Management Server ready; Ctrl-C ends it")
        await node.spin()
        worker.cancel()


if __name__ == "__main__":
    taskrpc.run(main())
