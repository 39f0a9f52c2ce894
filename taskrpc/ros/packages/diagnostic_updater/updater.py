"""Runs tasks again and again and publishes their reports."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from .status import DiagnosticStatusWrapper, checked_report

if TYPE_CHECKING:
    from rclpy.node import Node

_PERIOD = "diagnostic_updater.period"
_USE_FQN = "diagnostic_updater.use_fqn"


class _NamedTask(NamedTuple):
    name: str
    run: Callable[[Any], Any]


class DiagnosticTaskVector:
    """Tasks in the order in which they were added."""

    def __init__(self) -> None:
        self.tasks: list[_NamedTask] = []
        # A task may add another one.
        self.lock = threading.RLock()

    def addedTaskCallback(self, task: Any) -> None:
        """Called after a task was added; subclasses override it."""

    def add(self, *args: Any) -> None:
        """Add a task: `add(task)`, or `add(name, function)`."""
        name, run = (args[0].getName(), args[0].run) if len(args) == 1 else args
        if not callable(run):
            kind = type(run).__name__
            raise TypeError(f"expected a function as the task {name!r}, got {kind}")
        task = _NamedTask(name, run)
        with self.lock:
            self.tasks.append(task)
            self.addedTaskCallback(task)

    def removeByName(self, name: str) -> bool:
        """Remove the first task of this name; False if there is none."""
        with self.lock:
            for task in self.tasks:
                if task.name == name:
                    self.tasks.remove(task)
                    return True
        return False


class Updater(DiagnosticTaskVector):
    """Publishes the reports of all tasks on `/diagnostics`.

    Args:
        node: the node that publishes.
        period: seconds between two reports; the parameter `diagnostic_updater.period` has
            precedence.
    """

    def __init__(self, node: Node, period: float = 1.0) -> None:
        super().__init__()
        self.node = node
        self.publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 1)
        self.clock = node.get_clock()
        self.period = float(_parameter(node, _PERIOD, float(period)))
        self.use_fqn = bool(_parameter(node, _USE_FQN, False))
        self.timer = node.create_timer(self.period, self.update)
        self.verbose = False
        self.hwid = ""
        self.warn_nohwid_done = False

    def setHardwareID(self, hwid: str) -> None:
        """Name the device in all reports."""
        self.hwid = hwid

    def update(self) -> None:
        """Run all tasks and publish their reports; a timer calls it."""
        reports = []
        with self.lock:
            for task in list(self.tasks):
                status = DiagnosticStatusWrapper(
                    level=DiagnosticStatus.ERROR,
                    name=task.name,
                    message="No message was set",
                    hardware_id=self.hwid,
                )
                reports.append(checked_report(task.run(status), task.name))
        problems = [one for one in reports if one.level != DiagnosticStatus.OK]
        if self.verbose:
            for one in problems:
                self.node.get_logger().warning(
                    f"Non-zero diagnostic status. Name: {one.name}, status {one.level[0]}:"
                    f" {one.message}"
                )
        if not self.hwid and not problems and not self.warn_nohwid_done:
            self.warn_nohwid_done = True
            self.node.get_logger().warning(
                "diagnostic_updater: no hardware id is set; call setHardwareID, with 'none' for a"
                " node without a device"
            )
        self.publish(reports)

    def force_update(self) -> None:
        """Publish at once, for example after something has changed."""
        self.update()

    def broadcast(self, lvl: Any, msg: str) -> None:
        """Publish one level and message for all tasks, for example before a shutdown."""
        self.publish([self._report(task.name, lvl, msg) for task in list(self.tasks)])

    def publish(self, msg: Any) -> None:
        """Publish one status or a list of them."""
        node = self.node.get_fully_qualified_name() if self.use_fqn else self.node.get_name()
        array = DiagnosticArray()
        array.header.stamp = self.clock.now().to_msg()
        for one in msg if isinstance(msg, list) else [msg]:
            array.status.append(
                DiagnosticStatus(
                    level=one.level,
                    name=f"{node}: {one.name}",
                    message=one.message,
                    hardware_id=one.hardware_id,
                    values=list(one.values),
                )
            )
        self.publisher.publish(array)

    def addedTaskCallback(self, task: Any) -> None:
        """Report that the node is starting."""
        self.publish(self._report(task.name, DiagnosticStatus.OK, "Node starting up"))

    def _report(self, name: str, level: Any, message: str) -> DiagnosticStatusWrapper:
        status = DiagnosticStatusWrapper(name=name, hardware_id=self.hwid)
        status.summary(level, message)
        return status


def _parameter(node: Node, name: str, default: Any) -> Any:
    if node.has_parameter(name):
        return node.get_parameter(name).value
    return node.declare_parameter(name, default).value
