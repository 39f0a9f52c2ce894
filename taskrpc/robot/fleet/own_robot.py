"""What a server knows of its own robot: its record in the fleet, its plans, what it refuses."""

from __future__ import annotations

import contextlib
import logging
import os
import platform
from collections.abc import Iterable

from taskrpc.robot.driver import KinematicRobot
from taskrpc.robot.fleet.model import Capabilities, RobotRecord
from taskrpc.robot.fleet.offers import refuse_unable
from taskrpc.robot.fleet.state import FleetState
from taskrpc.robot.protocol import Plan, Pose, Robot, TargetError
from taskrpc.robot.tasks.robot_guard import RobotGuard, checked_plan, error_text
from taskrpc.robot.world import World
from taskrpc.spi import present_chance

_log = logging.getLogger("taskrpc.fleet")

_UNKNOWN = 30.0  # robot seconds that another robot is expected to need for what this one cannot do


class OwnRobot:
    """A server's own robot as a member of its fleet.

    Args:
        name: the robot's name in the fleet.
        guard: the robot.
        capabilities: see `Capabilities`.

    Raises:
        ValueError: the capabilities are not valid.
    """

    def __init__(self, name: str, guard: RobotGuard, capabilities: str) -> None:
        self._name = name
        self._guard = guard
        self._capabilities = capabilities
        self._places = _places(guard.robot)
        if unused := Capabilities(capabilities).unused(guard.robot.task_types, self._places):
            _log.warning(
                "the capabilities %s allow nothing: this robot does %s; check the spelling",
                " and ".join(unused),
                ", ".join(guard.robot.task_types),
            )

    def record(self) -> RobotRecord:
        """Return what the fleet's database is told about the robot and this server."""
        robot = self._guard.robot
        return RobotRecord(
            name=self._name,
            server=present_chance().randbytes(8).hex(),
            host=platform.node(),
            pid=os.getpid(),
            task_types=tuple(robot.task_types),
            capabilities=self._capabilities,
            places=self._places,
            size=_size(robot),
            tells_all=hasattr(robot, "places")
            or getattr(type(robot), "plan", None) is KinematicRobot.plan,
            speed=self._guard.speed,
            pose=self._guard.pose(),
        )

    def plan(self, robot: RobotRecord, task_type: str, target: str, pose: Pose) -> Plan | None:
        """Return the plan of any robot of the fleet, by this server's own robot; see `Planner`."""
        try:
            return checked_plan(self._guard.robot, task_type, target, pose)
        except Exception:  # a robot of the user's own may raise anything
            return None if robot.name == self._name else Plan(_UNKNOWN, pose)

    def wrong_target(self, task_type: str, target: str) -> str:
        """Return why the robot refuses a target, "" if it does not, or if it fails."""
        try:
            checked_plan(self._guard.robot, task_type, target, self._guard.pose())
        except TargetError as error:
            return error_text(error)
        except Exception:  # it may be able to plan the task later
            return ""
        return ""

    def refusal(self, state: FleetState, now: float, task_type: str, target: str) -> str:
        """Return why no robot of the fleet can execute a task, "" if one can.

        The own robot judges for itself. For the others, their records do.
        """
        own, refusal = state.robots.get(self._name), ""
        abilities = state.abilities()
        able, certain = abilities.of(task_type, target), abilities.certain(task_type, target)
        if own is not None and task_type in own.task_types:
            refusal = self._guard.refusal(task_type, target)
            # Even if its lease has just ended: this server runs and will renew it.
            if not refusal and self._name in able:
                return ""
        if not refusal:  # nothing speaks against the target; its capabilities or types differ
            certain = able
        if certain & {robot.name for robot in state.known_robots(now)} - {self._name}:
            return ""
        offers = {robot.offer() for robot in state.live_robots(now)}
        if refusal and own is not None and offers <= {own.offer()}:
            return refusal  # it names what every robot offers
        return refuse_unable(state, now, task_type, target)


def _places(robot: Robot) -> tuple[str, ...]:
    """Return the named places that a robot reaches; none if it does not tell."""
    of_map: Iterable[object] = getattr(getattr(robot, "world", None), "places", ())
    places: Iterable[object] = getattr(robot, "places", of_map)
    return tuple(sorted({str(place) for place in places if _reaches(robot, str(place))}))


def _reaches(robot: Robot, place: str) -> bool:
    for task_type in robot.task_types:
        with contextlib.suppress(Exception):  # a robot of the user's own may raise anything
            robot.plan(task_type, place, robot.pose())
            return True
    return False


def _size(robot: Robot) -> tuple[float, float] | None:
    """Return the width and height of a robot's map, None if it has none."""
    world = getattr(robot, "world", None)
    return (float(world.size[0]), float(world.size[1])) if isinstance(world, World) else None
