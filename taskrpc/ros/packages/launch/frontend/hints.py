"""What to write instead of a wrong name in an XML or YAML launch file, such as one of ROS 1."""

from __future__ import annotations

from collections.abc import Iterable

from srvgen.definitions.names import similar_names

_SUBSTITUTIONS = {
    "arg": "in ROS 2, write $(var NAME)",
    "find": "in ROS 2, write $(find-pkg-share PACKAGE)",
    "optenv": "in ROS 2, write $(env NAME DEFAULT)",
    "find-pkg": "write $(find-pkg-share PACKAGE)",
}
_ELEMENTS = {
    "param": "in ROS 2, write it inside the node; for all nodes, write set_parameter",
    "rosparam": "in ROS 2, write a param with the attribute `from` inside the node",
    "remap": "in ROS 2, write it inside the node; for all nodes, write set_remap",
    "env": "in ROS 2, write set_env",
}
_ATTRIBUTES = {
    ("node", "type"): "in ROS 2, its name is exec",
    ("node", "ns"): "in ROS 2, its name is namespace",
    ("node", "executable"): "its name is exec",
    ("node", "package"): "its name is pkg",
    ("node", "parameters"): "its name is param",
    ("node", "remappings"): "its name is remap",
    ("group", "ns"): "in ROS 2, write push_ros_namespace inside the group",
    ("include", "ns"): "in ROS 2, write a group with push_ros_namespace around it",
}


def substitution_hint(name: str, known: Iterable[str]) -> str:
    """What to write instead of an unknown substitution, behind `; `; "" for no idea."""
    return _joined(_SUBSTITUTIONS.get(name, ""), name, known)


def element_hint(name: str, known: Iterable[str]) -> str:
    """What to write instead of an unknown element, behind `; `; "" for no idea."""
    return _joined(_ELEMENTS.get(name, ""), name, known)


def attribute_hint(element: str, names: Iterable[str], known: Iterable[str]) -> str:
    """What to write instead of unknown attributes of an element, behind `; `; "" for no idea."""
    for name in names:
        hint = _ATTRIBUTES.get((element, name), "")
        if found := _joined(hint and f"`{name}`: {hint}", name, known):
            return found
    return ""


def _joined(hint: str, name: str, known: Iterable[str]) -> str:
    if hint:
        return f"; {hint}"
    guesses = similar_names(name, known)
    return f"; did you mean {' or '.join(guesses)}?" if guesses else ""
