"""Reads robot descriptions (URDF): the links of a robot, and the joints between them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import NamedTuple
from xml.parsers import expat

from tf2_py.geometry import ORIGIN, Transform, Vector, quaternion_of_angles

MOVING = ("revolute", "continuous", "prismatic")
"""The types of joints whose position is one number."""
TYPES = (*MOVING, "fixed", "floating", "planar")
"""All types of joints."""

_LIMITED = ("revolute", "prismatic")
_MOST_CHARACTERS = 2**24
_MOST_ELEMENTS = 200_000
_DEEPEST = 100


class UrdfError(ValueError):
    """A text is not a valid robot description; the message has the line where there is one."""


class Mimic(NamedTuple):
    """The joint that another joint follows."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


class Joint(NamedTuple):
    """A joint between two links."""

    name: str
    type: str
    """One of `TYPES`."""
    parent: str
    child: str
    origin: Transform = Transform()
    """Where the joint is in the frame of its parent."""
    axis: Vector = (1.0, 0.0, 0.0)
    """The direction of the motion in the frame of the joint; its length is 1."""
    limits: tuple[float, float] | None = None
    """The lowest and the highest position, None without limits."""
    soft_limits: tuple[float | None, float | None] = (None, None)
    """The limits of the safety controller."""
    mimic: Mimic | None = None


class Robot(NamedTuple):
    """A robot description; its links are a tree."""

    name: str
    links: tuple[str, ...]
    joints: tuple[Joint, ...]
    root: str
    """The link without a parent."""


class _Element:
    def __init__(self, tag: str, attributes: dict[str, str], line: int) -> None:
        self.tag = tag
        self.attributes = attributes
        self.line = line
        self.children: list[_Element] = []

    def all(self, tag: str) -> Iterator[_Element]:
        return (child for child in self.children if child.tag == tag)

    def first(self, tag: str) -> _Element | None:
        return next(self.all(tag), None)


def parse(text: str) -> Robot:
    """Read a robot description. Raises UrdfError."""
    robot = _read_xml(text)
    if robot.tag != "robot":
        raise UrdfError(f"line {robot.line}: expected the element <robot>, got <{robot.tag}>")
    links = tuple(_text(link, "name") for link in robot.all("link"))
    joints = tuple(_joint(joint) for joint in robot.all("joint"))
    _refuse_repeated("link", links)
    _refuse_repeated("joint", tuple(joint.name for joint in joints))
    return Robot(robot.attributes.get("name", ""), links, joints, _root(links, joints))


# --- XML --------------------------------------------------------------------------------------


def _read_xml(text: str) -> _Element:
    """The outermost element. Definitions of entities are refused: they can grow without limit."""
    if len(text) > _MOST_CHARACTERS:
        raise UrdfError(f"expected at most {_MOST_CHARACTERS} characters, got {len(text)}")
    parser = expat.ParserCreate()
    opened: list[_Element] = []
    found: list[_Element] = []
    count = 0

    def begin(tag: str, attributes: dict[str, str]) -> None:
        nonlocal count
        count += 1
        if count > _MOST_ELEMENTS or len(opened) >= _DEEPEST:
            raise UrdfError(
                f"line {parser.CurrentLineNumber}: expected at most {_MOST_ELEMENTS} elements, and"
                f" at most {_DEEPEST} inside each other"
            )
        element = _Element(tag, attributes, parser.CurrentLineNumber)
        (opened[-1].children if opened else found).append(element)
        opened.append(element)

    def refuse(*_: object) -> None:
        raise UrdfError(f"line {parser.CurrentLineNumber}: a <!DOCTYPE ...> is not allowed")

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: opened.pop()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text.lstrip(), True)
    except expat.ExpatError as error:
        problem = expat.ErrorString(error.code)
        raise UrdfError(f"line {error.lineno}: invalid XML: {problem}") from None
    except UnicodeEncodeError:
        raise UrdfError("expected text that UTF-8 can encode, got a lone surrogate") from None
    return found[0]


def _text(element: _Element, name: str) -> str:
    found = element.attributes.get(name, "")
    if not found:
        raise UrdfError(f"line {element.line}: <{element.tag}> needs the attribute '{name}'")
    return found


def _number(element: _Element, name: str, default: float | None = None) -> float:
    text = element.attributes.get(name)
    if text is None and default is not None:
        return default
    return _finite(element, name, _text(element, name))


def _finite(element: _Element, name: str, text: str) -> float:
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        where = f"line {element.line}: '{name}' of <{element.tag}>"
        raise UrdfError(f"{where}: expected a number, got {text!r}")
    return number


def _vector(element: _Element, name: str, default: Vector) -> Vector:
    text = element.attributes.get(name)
    if text is None:
        return default
    words = text.split()
    if len(words) != 3:
        where = f"line {element.line}: '{name}' of <{element.tag}>"
        raise UrdfError(f"{where}: expected three numbers, got {text!r}")
    x, y, z = (_finite(element, name, word) for word in words)
    return (x, y, z)


# --- joints -----------------------------------------------------------------------------------


def _joint(element: _Element) -> Joint:
    name, type_ = _text(element, "name"), _text(element, "type")
    if type_ not in TYPES:
        expected = ", ".join(TYPES)
        raise UrdfError(
            f"line {element.line}: joint '{name}' has the type '{type_}'; expected"
            f" one of {expected}"
        )
    limit = element.first("limit")
    if limit is None and type_ in _LIMITED:
        raise UrdfError(f"line {element.line}: the {type_} joint '{name}' needs a <limit .../>")
    return Joint(
        name,
        type_,
        _link_of(element, "parent"),
        _link_of(element, "child"),
        _origin(element),
        _axis(element),
        None if limit is None else _limits(limit),
        _soft_limits(element),
        _mimic(element),
    )


def _link_of(joint: _Element, tag: str) -> str:
    element = joint.first(tag)
    if element is None:
        raise UrdfError(
            f"line {joint.line}: joint '{joint.attributes['name']}' needs a <{tag} link=.../>"
        )
    return _text(element, "link")


def _origin(joint: _Element) -> Transform:
    element = joint.first("origin")
    if element is None:
        return Transform()
    roll, pitch, yaw = _vector(element, "rpy", ORIGIN)
    return Transform(_vector(element, "xyz", ORIGIN), quaternion_of_angles(roll, pitch, yaw))


def _axis(joint: _Element) -> Vector:
    element = joint.first("axis")
    if element is None:
        return (1.0, 0.0, 0.0)
    x, y, z = _vector(element, "xyz", (1.0, 0.0, 0.0))
    length = math.hypot(x, y, z)
    if length == 0:
        raise UrdfError(f"line {element.line}: expected the direction of an axis, got 0 0 0")
    return (x / length, y / length, z / length)


def _limits(element: _Element) -> tuple[float, float]:
    for name in ("effort", "velocity"):  # URDF requires both
        _number(element, name)
    return _number(element, "lower", 0.0), _number(element, "upper", 0.0)


def _soft_limits(joint: _Element) -> tuple[float | None, float | None]:
    element = joint.first("safety_controller")
    if element is None:
        return (None, None)
    low, high = (
        _number(element, name) if name in element.attributes else None
        for name in ("soft_lower_limit", "soft_upper_limit")
    )
    return (low, high)


def _mimic(joint: _Element) -> Mimic | None:
    element = joint.first("mimic")
    if element is None:
        return None
    numbers = _number(element, "multiplier", 1.0), _number(element, "offset", 0.0)
    return Mimic(_text(element, "joint"), *numbers)


# --- the tree ---------------------------------------------------------------------------------


def _refuse_repeated(what: str, names: tuple[str, ...]) -> None:
    seen: set[str] = set()
    for name in names:
        if name in seen:
            raise UrdfError(f"{what} '{name}' is not unique")
        seen.add(name)


def _root(links: tuple[str, ...], joints: tuple[Joint, ...]) -> str:
    """The link without a parent. Raises UrdfError if the links are not one tree."""
    if not links:
        raise UrdfError("expected at least one <link name=.../>, got none")
    joint_above: dict[str, Joint] = {}
    for joint in joints:
        for side, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in links:
                raise UrdfError(
                    f"{side} link '{link}' of joint '{joint.name}' not found: add"
                    f' <link name="{link}"/>, or remove the joint'
                )
        if (other := joint_above.get(joint.child)) is not None:
            raise UrdfError(
                f"link '{joint.child}' is the child of two joints: '{other.name}', '{joint.name}'"
            )
        joint_above[joint.child] = joint
    roots = [link for link in links if link not in joint_above]
    if len(roots) > 1:
        raise UrdfError(
            f"two root links found: '{roots[0]}' and '{roots[1]}'; connect them with a joint"
        )
    # Each link has at most one parent. So the links are a tree if all have a way up to the root.
    reached = set(roots)
    for link in links:
        above, way = link, set[str]()
        while above not in reached and above not in way:
            way.add(above)
            above = joint_above[above].parent
        if above in way:
            raise UrdfError(f"the joints connect '{above}' in a circle; expected a tree of links")
        reached |= way
    return roots[0]
