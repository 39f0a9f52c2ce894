"""The map: named places, obstacles, shortest paths around them, and the ranges of a scan."""

import difflib
import math
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache
from heapq import heappop, heappush
from itertools import pairwise

from taskrpc.robot.kinematics import Point
from taskrpc.robot.obstacles import Box
from taskrpc.robot.protocol import Pose, TargetError

DOCK = "dock"
"""The target name of every map's dock."""

_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_COORDINATES = re.compile(rf"\s*({_NUMBER})(?:\s*,\s*|\s+)({_NUMBER})\s*", re.ASCII)
_TOUCH = 1e-9  # metres; as in obstacles: touching an outer wall is allowed
_REMEMBERED_PATHS = 4096


class World:
    """A rectangular floor with obstacles; in metres, with the origin in the lower left corner.

    Points are positions of the centre of a round robot. The robot keeps `robot_radius` away from
    the outer walls and from every obstacle.

    Args:
        size: width and height; outer walls close the floor on all sides.
        obstacles: walls and boxes, see `Box.wall` and `Box.rectangle`.
        places: named targets, besides "x,y" and the dock.
        dock: where the robot starts and charges.
        robot_radius: metres.
    """

    def __init__(
        self,
        size: Point,
        *,
        dock: Point,
        obstacles: Sequence[Box] = (),
        places: Mapping[str, Point] | None = None,
        robot_radius: float = 0.25,
    ) -> None:
        self.size = size
        self.dock = dock
        self.obstacles = tuple(obstacles)
        self.places = {**(places or {}), DOCK: dock}
        self.robot_radius = robot_radius
        self._keep_out = tuple(box.inflated(robot_radius) for box in self.obstacles)
        # A shortest path bends only at the corners of obstacles that lie on the free floor.
        self._bends = tuple(p for box in self._keep_out for p in box.corners() if self.is_free(p))
        self._bends_seen_from: dict[Point, list[Point]] = {}
        self._remembered_path = lru_cache(_REMEMBERED_PATHS)(self._path)

    def is_free(self, point: Point) -> bool:
        """Return whether the robot's centre can be at this point."""
        return self._is_on_floor(point, self.robot_radius) and not any(
            box.contains(point) for box in self._keep_out
        )

    def resolve(self, target: str) -> Point:
        """Return the point of a target: a named place, or "x,y" or "x y" in metres.

        Raises:
            TargetError: it is neither, or the robot cannot stand there.
        """
        name = target.strip()
        point = self.places.get(name) or coordinates(name)
        if point is None:
            raise TargetError(self._unknown(name))
        if not self._is_on_floor(point, 0.0):
            width, height = self.size
            raise TargetError(
                f"target {name!r} is outside the map: x goes from 0 to {width:g}, "
                f"y from 0 to {height:g} metres"
            )
        if not self.is_free(point):
            raise TargetError(
                f"the robot cannot stand at {name!r}: a wall or obstacle is nearer than its "
                f"radius of {self.robot_radius:g} metres"
            )
        return point

    def path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        """Return the waypoints of the shortest path from `start` to `goal`, None if there is none.

        The same arguments give the same path, also if two paths are equally short.
        """
        return self._remembered_path(start, goal)

    def way(self, start: Point, target: str) -> tuple[Point, ...]:
        """Return the waypoints of the shortest path to a target; the last one is the target.

        Raises:
            TargetError: as `resolve`, or there is no path.
        """
        waypoints = self.path(start, self.resolve(target))
        if waypoints is None:
            raise TargetError(
                f"no way leads from {start[0]:g},{start[1]:g} to {target.strip()!r}: "
                f"walls are in between, or a gap is too narrow for the robot"
            )
        return waypoints

    def cast(self, pose: Pose, angles: Sequence[float], max_range: float) -> list[float]:
        """Return the ranges in metres from `pose` to the first obstacle at each angle.

        Angles are radians counterclockwise from the robot's heading. No range is longer than
        `max_range`.
        """
        origin = pose.x, pose.y
        ranges = []
        for angle in angles:
            direction = math.cos(pose.theta + angle), math.sin(pose.theta + angle)
            seen = [box.ray(origin, direction) for box in self.obstacles]
            ranges.append(min(*seen, self._to_outer_wall(origin, direction), max_range))
        return ranges

    def _is_on_floor(self, point: Point, margin: float) -> bool:
        margin -= _TOUCH
        return (
            margin <= point[0] <= self.size[0] - margin
            and margin <= point[1] <= self.size[1] - margin
        )

    def _unknown(self, name: str) -> str:
        if not name:
            problem = "the target is empty"
        else:
            near = difflib.get_close_matches(name.casefold(), self.places, n=1)
            guess = f" (did you mean {near[0]!r}?)" if near else ""
            problem = f"unknown target {name!r}{guess}"
        return f"{problem}: expected a place ({', '.join(sorted(self.places))}) or x,y in metres"

    def _is_clear(self, start: Point, end: Point) -> bool:
        return not any(box.blocks(start, end) for box in self._keep_out)

    def _path(self, start: Point, goal: Point) -> tuple[Point, ...] | None:
        if not (self.is_free(start) and self.is_free(goal)):
            return None
        if self._is_clear(start, goal):
            return (goal,)
        came_from = self._search(start, goal)
        if goal not in came_from:
            return None
        points = [goal]
        while points[-1] != start:
            points.append(came_from[points[-1]])
        return tuple(self._without_needless_stops(points[::-1]))

    def _search(self, start: Point, goal: Point) -> dict[Point, Point]:
        """Search with A* over the bends; returns each reached point with the point before it."""
        came_from: dict[Point, Point] = {}
        frontier = [(math.dist(start, goal), 0.0, start, start)]
        while frontier and goal not in came_from:
            _, behind, point, previous = heappop(frontier)
            if point in came_from:
                continue
            came_from[point] = previous
            for onward in self._onward(point, goal):
                length = behind + math.dist(point, onward)
                heappush(frontier, (length + math.dist(onward, goal), length, onward, point))
        return came_from

    def _onward(self, point: Point, goal: Point) -> list[Point]:
        """Return the bends, and the goal, that a straight line from `point` reaches."""
        seen = self._bends_seen_from.get(point)
        if seen is None:
            seen = [bend for bend in self._bends if self._is_clear(point, bend)]
            if point in self._bends:
                self._bends_seen_from[point] = seen
        return [*seen, goal] if self._is_clear(point, goal) else seen

    def _without_needless_stops(self, points: list[Point]) -> list[Point]:
        """Return the waypoints without those on a straight line between their neighbours."""
        kept = points[:1]
        for point, onward in pairwise(points[1:]):
            if not self._is_clear(kept[-1], onward):
                kept.append(point)
        return [*kept[1:], points[-1]]

    def _to_outer_wall(self, origin: Point, direction: Point) -> float:
        return min(
            ((end if slope > 0.0 else 0.0) - start) / slope
            for start, slope, end in zip(origin, direction, self.size, strict=True)
            if slope != 0.0
        )


def coordinates(text: str) -> Point | None:
    """Return the point of "x,y" or "x y" in metres, None for any other text."""
    match = _COORDINATES.fullmatch(text)
    return (float(match[1]), float(match[2])) if match else None
