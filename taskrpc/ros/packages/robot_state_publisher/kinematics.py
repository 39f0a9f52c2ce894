"""Computes the transforms of a robot from the positions of its joints, and when to send them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from tf2_py.geometry import NO_ROTATION, ORIGIN, Transform, normalized

from .urdf import MOVING, Joint, Robot

_PLACED_ONCE = ("fixed", "planar")
"""Types whose transform is static. KDL knows no planar joints, so ROS takes them for fixed ones."""


class Placed(NamedTuple):
    """A frame, and where it is in the frame of its parent."""

    parent: str
    child: str
    transform: Transform


def pose(joint: Joint, position: float = 0.0) -> Transform:
    """Where the child of a joint is in the frame of the parent; in radians or metres."""
    x, y, z = joint.axis
    if joint.type == "prismatic":
        moved = Transform((x * position, y * position, z * position), NO_ROTATION)
    elif joint.type in MOVING:
        sine = math.sin(position / 2)
        moved = Transform(ORIGIN, (x * sine, y * sine, z * sine, math.cos(position / 2)))
    else:
        moved = Transform()
    found = joint.origin.after(moved)
    return Transform(found.translation, normalized(found.rotation))


def fixed_frames(robot: Robot) -> list[Placed]:
    """The frames that never move. Those of floating joints are left out: nobody knows them."""
    return [
        Placed(joint.parent, joint.child, pose(joint))
        for joint in sorted(robot.joints)
        if joint.type in _PLACED_ONCE
    ]


def moving_frames(robot: Robot, positions: Mapping[str, float]) -> list[Placed]:
    """The frames of the joints that have a position; joints that mimic one of them have one too."""
    known = dict(positions)
    for joint in sorted(robot.joints):
        if joint.mimic is not None and joint.mimic.joint in known:
            followed = known[joint.mimic.joint]
            known.setdefault(joint.name, followed * joint.mimic.multiplier + joint.mimic.offset)
    return [
        Placed(joint.parent, joint.child, pose(joint, known[joint.name]))
        for joint in sorted(robot.joints)
        if joint.type in MOVING and joint.name in known
    ]


class Pace:
    """Decides which messages with joint states to use; times are in nanoseconds.

    Args:
        frequency: messages a second at most, for each joint.
    """

    def __init__(self, frequency: float) -> None:
        self.frequency = frequency
        self._sent: dict[str, int] = {}
        """The stamp of the last message that was used, by joint."""
        self._now = 0

    def went_back(self, now: int) -> bool:
        """Note the time; returns whether it is earlier than before, so that all joints are new."""
        is_earlier, self._now = now < self._now, now
        if is_earlier:
            self._sent.clear()
        return is_earlier

    def is_due(self, names: Sequence[str], stamp: int) -> bool:
        """Whether a message for these joints is to be used."""
        oldest = min([self._now, *(self._sent.get(name, 0) for name in names)])
        return stamp >= oldest + int(1000 / self.frequency) * 1_000_000  # ROS counts milliseconds

    def used(self, names: Sequence[str], stamp: int) -> None:
        """Note that a message was used."""
        self._sent.update(dict.fromkeys(names, stamp))
