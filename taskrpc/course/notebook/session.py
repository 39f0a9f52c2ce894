"""What a notebook has once: its nodes, the robot, the picture and the lab."""

from __future__ import annotations

import importlib
import os
import sys
import sysconfig
from functools import cache
from pathlib import Path
from shutil import which
from typing import Any

import taskrpc
from taskrpc.course.notebook import jupyter
from taskrpc.course.notebook.background import Spinners
from taskrpc.course.notebook.labs import NotebookLab
from taskrpc.course.notebook.live import View
from taskrpc.course.notebook.nodes import NotebookNodes
from taskrpc.course.notebook.robot import NotebookRobot
from taskrpc.errors import TaskRpcError
from taskrpc.robot.mapfile import default_world
from taskrpc.robot.world import World
from taskrpc.ros import hook


class Session:
    """The state of this notebook; get it with `session()`."""

    def __init__(self) -> None:
        self._nodes = NotebookNodes()
        self._spinners = Spinners()
        self._robot: NotebookRobot | None = None
        self._view: View | None = None
        self._default_world: World | None = None
        self._lab: NotebookLab | None = None

    def begin(self) -> None:
        """Let nodes be replaced, errors be short, and rclpy be imported."""
        taskrpc.Node.default_observer = self._nodes
        self._nodes.leaves = self._spinners.stop
        _find_commands()
        errors: list[type[Exception]] = []
        if not hook.real_rclpy():
            hook.install(Path.cwd())
            importlib.import_module("rclpy._impl.cells").current = self._nodes  # type: ignore[attr-defined]
            rclpy_errors = vars(importlib.import_module("rclpy.exceptions")).values()
            errors += [each for each in rclpy_errors if _is_error(each)]
        jupyter.install(self._nodes.cell_begins, {"lab": self._write}, errors)

    def spin(self, node: Any) -> None:
        """Spin a node of rclpy in the background."""
        rclpy_node = sys.modules.get("rclpy.node")
        if rclpy_node is None or not isinstance(node, rclpy_node.Node):
            raise TaskRpcError(
                f"spin: expected a node of rclpy, got {node!r};"
                " nodes of taskrpc need no spin: their callbacks run at once"
            )
        self._spinners.spin(node)

    def start_robot(self, speed: float, map: str) -> None:
        """Start the simulated robot, or start it again."""
        if self._robot is not None:
            self._robot.stop()
            self._robot = None
        robot = NotebookRobot(self._nodes, speed, map)
        robot.start()
        self._robot = robot

    def stop_robot(self) -> None:
        """Stop the simulated robot, if it runs."""
        if self._robot is not None:
            self._robot.stop()
            self._robot = None

    def view(self, seconds: float | None) -> None:
        """Draw the picture, and end the one before."""
        if self._view is not None:
            self._view.stop()
        view = self._view = View(jupyter.Picture(), self._nodes, self._world)
        view.draw_once()
        if not jupyter.is_notebook():
            view.stop()
        elif seconds is None:
            view.follow()
        else:
            view.follow_for(seconds)

    def lab(self, number: int) -> None:
        """Begin or continue a lab."""
        lab = NotebookLab(number, Path.cwd(), jupyter.run_in_cell)
        lab.begin()
        self._lab = lab
        print(f"Lab {number}: {lab.lab.title} (about {lab.lab.minutes} minutes)")
        print(lab.lab.goal)
        print(f"Your files are in {lab.folder}")

    def begun_lab(self) -> NotebookLab:
        """Return the lab of this notebook. Raises TaskRpcError if none was begun."""
        if self._lab is None:
            raise TaskRpcError(
                "no lab was begun in this notebook: run its first cell, which calls notebook.lab(1)"
            )
        return self._lab

    def _write(self, name: str, text: str) -> None:
        """The magic `%%lab FILE`."""
        self.begun_lab().write(name.strip(), text)

    def _world(self) -> World:
        if self._robot is not None:
            return self._robot.world
        if self._default_world is None:
            self._default_world = default_world()
        return self._default_world


def _is_error(value: object) -> bool:
    return isinstance(value, type) and issubclass(value, Exception)


def _find_commands() -> None:
    """Let `!taskrpc` in a cell run the command of this environment, which may not be active."""
    folder = sysconfig.get_path("scripts")
    command = which("taskrpc", path=folder)
    if command is not None and which("taskrpc") != command:
        os.environ["PATH"] = os.pathsep.join([folder, os.environ.get("PATH", os.defpath)])


@cache
def session() -> Session:
    """Return the state of this notebook; the first call prepares it."""
    made = Session()
    made.begin()
    return made
