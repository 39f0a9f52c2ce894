"""The states of the joints of a robot, as `joint_state_publisher` publishes them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from robot_state_publisher.urdf import MOVING, Joint, Mimic, Robot


@dataclass(frozen=True)
class Settings:
    """The parameters of the node."""

    zeros: Mapping[str, float] = field(default_factory=dict)
    """The first positions of joints; without one, 0 or the middle of the limits."""
    dependent_joints: Mapping[str, Mimic] = field(default_factory=dict)
    """Joints that follow others."""
    use_mimic_tags: bool = True
    use_smallest_joint_limits: bool = True
    publish_default_positions: bool = True
    publish_default_velocities: bool = False
    publish_default_efforts: bool = False


@dataclass
class FreeJoint:
    """A joint that follows no other; None is a value that nobody has set."""

    low: float
    high: float
    is_continuous: bool
    zero: float
    position: float | None = None
    velocity: float | None = None
    effort: float | None = None
    goes_up: bool = True

    def move(self, delta: float) -> None:
        """Move towards a limit and turn round there; a continuous joint begins anew."""
        position = self.zero if self.position is None else self.position
        position += delta if self.goes_up else -delta
        if position > self.high:
            self.goes_up = self.is_continuous
            position = self.low if self.is_continuous else self.high
        elif not self.goes_up and position < self.low:
            self.goes_up = True
            position = self.low
        self.position = position


@dataclass(frozen=True)
class JointStates:
    """A message with joint states; a list is empty if no joint has such a value."""

    names: list[str]
    positions: list[float]
    velocities: list[float]
    efforts: list[float]


class Joints:
    """The joints of a robot.

    Raises:
        ValueError: a joint follows itself, or one that is not there.
    """

    def __init__(self, robot: Robot, settings: Settings) -> None:
        self.free: dict[str, FreeJoint] = {}
        self._names = [joint.name for joint in robot.joints if joint.type in MOVING]
        self._followed = dict(settings.dependent_joints)
        moving = [joint for joint in robot.joints if joint.type in MOVING]
        for joint in moving:
            if settings.use_mimic_tags and joint.mimic is not None:
                self._followed[joint.name] = joint.mimic
            elif joint.name not in self._followed:
                self.free[joint.name] = _free(joint, settings)
        self._sources = {name: self._source(name) for name in self._names}
        """The free joint whose values a joint has, by the name of the joint."""

    def _source(self, name: str) -> Mimic:
        factor, offset, way = 1.0, 0.0, [name]
        while name not in self.free:
            followed = self._followed.get(name)
            if followed is None:
                raise ValueError(
                    f"joint '{way[-2]}' follows the joint '{name}', which is not there"
                )
            offset += factor * followed.offset
            factor *= followed.multiplier
            name = followed.joint
            if name in way:
                raise ValueError(f"Found an infinite recursive mimic chain: {[*way, name]}")
            way.append(name)
        return Mimic(name, factor, offset)

    def take(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> None:
        """Take the values of a message; an empty list leaves what the joints have."""
        for index, name in enumerate(names):
            joint = self.free.get(name)
            if joint is None:
                continue
            joint.position = positions[index] if index < len(positions) else joint.position
            joint.velocity = velocities[index] if index < len(velocities) else joint.velocity
            joint.effort = efforts[index] if index < len(efforts) else joint.effort

    def move(self, delta: float) -> None:
        """Move all free joints by this much, in radians or metres."""
        for joint in self.free.values():
            joint.move(delta)

    def states(self) -> JointStates:
        """The states to publish, in the order of the robot description."""
        positions = self._values("position")
        return JointStates(
            list(self._names), positions, self._values("velocity"), self._values("effort")
        )

    def _values(self, name: str) -> list[float]:
        found: list[Any] = [getattr(self.free[each.joint], name) for each in self._sources.values()]
        if all(value is None for value in found):
            return []
        values = []
        for value, source in zip(found, self._sources.values(), strict=True):
            if value is None:
                values.append(0.0)
            elif name == "position":
                values.append(float(value) * source.multiplier + source.offset)
            else:
                values.append(float(value) * (source.multiplier if name == "velocity" else 1.0))
        return values


def _free(joint: Joint, settings: Settings) -> FreeJoint:
    low, high = _limits(joint, smallest=settings.use_smallest_joint_limits)
    middle = (low + high) / 2 if low > 0 or high < 0 else 0.0
    zero = float(settings.zeros.get(joint.name, middle))
    return FreeJoint(
        low,
        high,
        joint.type == "continuous",
        zero,
        zero if settings.publish_default_positions else None,
        0.0 if settings.publish_default_velocities else None,
        0.0 if settings.publish_default_efforts else None,
    )


def _limits(joint: Joint, *, smallest: bool) -> tuple[float, float]:
    if joint.type == "continuous" or joint.limits is None:
        low, high = -math.pi, math.pi
    else:
        low, high = joint.limits
    soft_low, soft_high = joint.soft_limits
    if smallest and soft_low is not None:
        low = max(low, soft_low)
    if smallest and soft_high is not None:
        high = min(high, soft_high)
    return low, high
