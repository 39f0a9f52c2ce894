"""The turtles of a window and how they move: turtlesim's physics. Pure.

Positions are metres from the lower left corner, headings are radians counter-clockwise from the
x axis. Time is an argument, in seconds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from taskrpc.ros.turtlesim.canvas import EMPTY, Canvas, Color, Pen, Point

PIXELS_PER_METRE = 45
SIDE = 11.088889122009277
"""Width and height of the world: 499 pixels. It is a float32, so that poses have ROS's digits."""
CENTRE = SIDE / 2
STEP = 0.016
"""Simulated time of one step [s]."""
COMMAND_LASTS = 1.0
"""How long a velocity command moves a turtle [s]."""
_CLOSE_ENOUGH = 0.02
"""A rotation is complete when the heading differs from its goal by less than this [rad]."""
_ROTATION_SPEED = 1.0
_FASTEST = 1e30
"""A higher velocity is limited to this: commands are float64, but poses are float32."""


@dataclass(frozen=True)
class Rotation:
    """A step of a rotation to a heading: what is left, and what is done [rad]."""

    remaining: float
    delta: float
    done: bool


@dataclass(frozen=True)
class Moved:
    """The outcome of one step of a turtle."""

    hit: Point | None = None
    """Where it would be without the wall, in metres from the upper left corner, as ROS prints."""
    rotation: Rotation | None = None
    """The progress of its rotation, if it has one."""


@dataclass
class _Teleport:
    x: float
    y: float
    theta: float


@dataclass
class _Shift:
    linear: float
    angular: float


@dataclass
class Turtle:
    """One turtle."""

    name: str
    x: float
    y: float
    theta: float
    pen: Pen = field(default_factory=Pen)
    linear_x: float = 0.0
    linear_y: float = 0.0
    angular: float = 0.0
    color: Color = EMPTY
    """The color below it at the last step."""
    _commanded: float = -math.inf
    _jumps: list[_Teleport | _Shift] = field(default_factory=list)
    _goal: float | None = None
    _goal_start: float = 0.0

    @property
    def speed(self) -> float:
        """Its linear speed."""
        return math.hypot(self.linear_x, self.linear_y)

    def command(self, linear_x: float, linear_y: float, angular: float, now: float) -> None:
        """Move with these velocities for `COMMAND_LASTS`, or until the next command."""
        self.linear_x, self.linear_y = _velocity(linear_x), _velocity(linear_y)
        self.angular = _velocity(angular)
        self._commanded = now

    def set_pen(self, color: Color, width: int, off: bool) -> None:
        """Draw with another pen from now on, or with none; a width of 0 means one pixel."""
        if off:
            self.pen = Pen(self.pen.color, self.pen.width, down=False)
        else:
            self.pen = Pen(color, width or 1)

    def teleport_absolute(self, x: float, y: float, theta: float) -> None:
        """Jump to a pose at the next step."""
        self._jumps.append(_Teleport(finite(x), finite(y), finite(theta)))

    def teleport_relative(self, linear: float, angular: float) -> None:
        """Turn and then jump ahead at the next step."""
        self._jumps.append(_Shift(finite(linear), finite(angular)))

    def rotate_to(self, theta: float) -> None:
        """Turn to a heading, in place of an earlier rotation."""
        self._goal, self._goal_start = finite(theta), self.theta

    def stop_rotation(self) -> None:
        """Stop a rotation where the turtle is now."""
        self._goal = None
        self.linear_x = self.linear_y = self.angular = 0.0

    def step(self, canvas: Canvas, now: float) -> Moved:
        """Move by one step and draw; the color is that below the turtle before it draws."""
        for jump in self._jumps:
            self._jump(jump, canvas)
        self._jumps.clear()
        rotation = None if self._goal is None else self._rotate(self._goal, now)
        if now - self._commanded > COMMAND_LASTS:
            self.linear_x = self.linear_y = self.angular = 0.0
        start = self.x, self.y
        self.theta = normalized(self.theta + self.angular * STEP)
        cosine, sine = math.cos(self.theta), math.sin(self.theta)
        x = self.x + (cosine * self.linear_x - sine * self.linear_y) * STEP
        y = self.y + (sine * self.linear_x + cosine * self.linear_y) * STEP
        self.x, self.y = _clamped(x), _clamped(y)
        hit = None if (x, y) == (self.x, self.y) else (x, SIDE - y)
        self.color = canvas.color_at(pixel(self.x, self.y))
        if (self.x, self.y) != start:
            canvas.draw(pixel(*start), pixel(self.x, self.y), self.pen)
        return Moved(hit, rotation)

    def _jump(self, jump: _Teleport | _Shift, canvas: Canvas) -> None:
        start = self.x, self.y
        if isinstance(jump, _Shift):
            self.theta += jump.angular
            self.x += math.cos(self.theta) * jump.linear
            self.y += math.sin(self.theta) * jump.linear
        else:
            # The original keeps y below the upper edge here; the step checks the other walls.
            self.x, self.y, self.theta = jump.x, min(jump.y, SIDE), jump.theta
        canvas.draw(pixel(*start), pixel(self.x, self.y), self.pen)

    def _rotate(self, goal: float, now: float) -> Rotation:
        remaining = normalized(goal - self.theta)
        delta = normalized(self._goal_start - self.theta)
        done = abs(remaining) < _CLOSE_ENOUGH
        if done:
            self.stop_rotation()
        else:
            self.command(0.0, 0.0, math.copysign(_ROTATION_SPEED, remaining), now)
        return Rotation(remaining, delta, done)


class World:
    """The turtles by name, and the canvas on which they draw."""

    def __init__(self) -> None:
        self.turtles: dict[str, Turtle] = {}
        self.canvas = Canvas()
        self._number = 0

    def free_name(self) -> str:
        """The name of the next turtle that gets none."""
        while True:
            self._number += 1
            if (name := f"turtle{self._number}") not in self.turtles:
                return name

    def spawn(self, name: str, x: float, y: float, theta: float) -> Turtle:
        """Add a turtle, whose name no other turtle has."""
        self.turtles[name] = turtle = Turtle(name, finite(x), finite(y), finite(theta))
        return turtle

    def step(self, now: float) -> dict[str, Moved]:
        """Move all turtles by one step, in the order of their names."""
        turtles = sorted(self.turtles.items())
        return {name: turtle.step(self.canvas, now) for name, turtle in turtles}

    def reset(self) -> None:
        """Remove all turtles and lines; names begin again at `turtle1`."""
        self.turtles.clear()
        self.canvas.clear()
        self._number = 0


def pixel(x: float, y: float) -> Point:
    """The point of the picture at a position of the world."""
    return x * PIXELS_PER_METRE, (SIDE - y) * PIXELS_PER_METRE


def normalized(angle: float) -> float:
    """The same angle between -pi and pi."""
    return math.remainder(angle, math.tau)


def finite(value: float) -> float:
    """The number, or 0 for infinity and NaN, which messages can carry."""
    return value if math.isfinite(value) else 0.0


def _velocity(value: float) -> float:
    return min(max(finite(value), -_FASTEST), _FASTEST)


def _clamped(value: float) -> float:
    return min(max(value, 0.0), SIDE)
