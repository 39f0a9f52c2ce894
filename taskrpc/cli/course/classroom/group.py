"""The service with which `taskrpc classroom reset` begins the next group on a running server."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from typing import Any

import srvgen
from taskrpc import Role
from taskrpc.course.classroom.archive import summary, write_archive
from taskrpc.course.classroom.attendance import Attendance
from taskrpc.course.classroom.register import Register
from taskrpc.course.classroom.resetting import begin_again, end_all
from taskrpc.errors import Code, HandlerError, StoreError
from taskrpc.node import Node
from taskrpc.robot.tasks.server import TaskServer

RESET = "robot_task/reset"
"""The name of the service, in the namespace of the robot."""


class GroupReset:
    """Ends the present group: its tasks, and what is known of its students.

    Args:
        server: the task server.
        register: the class.
        attendance: when each student last called.
        forget: forgets what the live page knows of the students.
        wall_clock: the time of day, in seconds since 1970.
    """

    def __init__(
        self,
        server: TaskServer,
        register: Register,
        attendance: Attendance | None,
        forget: Callable[[], object],
        wall_clock: Callable[[], float] = time.time,
    ) -> None:
        self._manager = server.manager
        self._register = register
        self._attendance = attendance
        self._forget = forget
        self._wall_clock = wall_clock
        self._busy = asyncio.Lock()

    def offer(self, node: Node) -> None:
        """Offer the service; only this user's own programs may call it."""
        trigger = srvgen.load("std_srvs/srv/Trigger")
        self._service = node.resolve_service_name(RESET)
        node.create_service(trigger, RESET, self, role=Role.ADMIN)

    async def __call__(self, request: Any, response: Any) -> Any:
        """Begin the next group; a std_srvs/srv/Trigger, whose message says what was done."""
        async with self._busy:
            try:
                response.message = await self._reset()
            except StoreError as error:
                raise HandlerError(Code.INTERNAL, str(error)) from error
            except OSError as error:
                where = f"{error.filename}: {error.strerror}"
                problem = f"the archive cannot be written, so the tasks are kept ({where})"
                raise HandlerError(Code.INTERNAL, problem) from error
        response.success = True
        return response

    async def _reset(self) -> str:
        tasks = await end_all(self._manager)
        service = self._service.removesuffix("/reset")
        path = write_archive(self._register, tasks, self._wall_clock(), service)
        problem = await begin_again(self._manager)
        if self._attendance is not None:
            self._attendance.clear()
        self._forget()
        return summary(len(tasks), path, problem)
