"""The simulated robot that records the start and the end of each move in a file."""

import os

from taskrpc.robot import KinematicRobot


class NotebookRobot(KinematicRobot):
    """Writes a line to the file named by $NOTEBOOK before and after each move."""

    def __init__(self, world, speed):
        super().__init__(world, speed=speed)
        self._notebook = os.open(
            os.environ["NOTEBOOK"], os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o600
        )

    async def execute(self, task_type, target, report):
        os.write(self._notebook, f"began {target}\n".encode())
        result = await super().execute(task_type, target, report)
        os.write(self._notebook, f"ended {target}\n".encode())
        return result
