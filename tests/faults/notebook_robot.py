"""The simulated robot, which writes down what it begins and ends: what really happened."""

import os

from taskrpc.robot import KinematicRobot


class NotebookRobot(KinematicRobot):
    """Writes a line to the file that $NOTEBOOK names, before it moves and after."""

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
