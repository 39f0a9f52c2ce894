"""The parameters, namespaces and remappings of a node, as arguments behind `--ros-args`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import yaml
from launch.logging import warn_once
from launch.substitution import perform

from .parameter_descriptions import Parameter, ParameterFile, temporary_file, value_of

PARAMETERS = "global_params"
"""The launch configuration with the parameters of `SetParameter` and `SetParametersFromFile`."""
REMAPPINGS = "ros_remaps"
"""The launch configuration with the rules of `SetRemap`."""
NAMESPACE = "ros_namespace"
"""The launch configuration with the namespace of `PushROSNamespace`."""


def joined_namespace(outer: str, inner: str) -> str:
    """A namespace inside another one; an absolute one stays as it is.

    Returns "" for none, else a name that begins with `/` and does not end with it.
    """
    if inner.startswith("/"):
        outer = ""
    parts = [part for text in (outer, inner) for part in text.split("/") if part]
    return f"/{'/'.join(parts)}" if parts else ("/" if inner.startswith("/") else "")


def evaluated(context: Any, values: Mapping[Any, Any], prefix: str = "") -> dict[str, Any]:
    """Compute a dict of parameters; inner dicts become names with dots."""
    found: dict[str, Any] = {}
    for key, value in values.items():
        name = prefix + perform(context, key)
        if isinstance(value, Mapping):
            found.update(evaluated(context, value, f"{name}."))
        else:
            found[name] = value_of(context, name, value)
    return found


def parameter_arguments(context: Any, node: str, parameters: Iterable[Any]) -> list[str]:
    """The arguments for a node's parameters: dicts, files and single parameters.

    Args:
        node: the node's full name; "" if the launch file does not name it.
    """
    found: list[str] = []
    for each in parameters:
        if isinstance(each, Parameter):
            name, value = each.evaluate(context)
            found += ["-p", f"{name}:={yaml_text(value)}"]
            continue
        if isinstance(each, Mapping):
            values = {node or "/**": {"ros__parameters": evaluated(context, each)}}
            path = temporary_file(context, yaml.safe_dump(values, allow_unicode=True))
        elif isinstance(each, ParameterFile):
            path = each.evaluate(context)
        else:
            path = Path(os.path.expanduser(perform(context, each)))
            if not path.is_file():  # the node starts, as in ROS
                warn_once(context, f"Parameter file path is not a file: {path}")
                continue
        found += ["--params-file", str(path)]
    return found


def yaml_text(value: Any) -> str:
    """A value as one line of YAML."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=2**30, allow_unicode=True)
    return text.removesuffix("\n").removesuffix("\n...")


def global_arguments(context: Any) -> list[str]:
    """The arguments for what `SetParameter`, `SetParametersFromFile` and `SetRemap` have set."""
    known = context.launch_configurations
    found: list[str] = []
    for each in known.get(PARAMETERS, ()):
        if isinstance(each, tuple):
            found += ["-p", f"{each[0]}:={yaml_text(each[1])}"]
        else:
            found += ["--params-file", each]
    return found


def remap_arguments(context: Any, rules: Iterable[tuple[Any, Any]]) -> list[str]:
    """The arguments for remappings: those of `SetRemap`, then the node's own."""
    pairs = []
    for rule in rules:
        if isinstance(rule, str) or len(rule) != 2:
            raise TypeError(
                f"remappings: expected pairs of an old and a new name, ('/a', '/b'), got {rule!r}"
            )
        pairs.append((perform(context, rule[0]), perform(context, rule[1])))
    every = [*context.launch_configurations.get(REMAPPINGS, ()), *pairs]
    return [word for old, new in every for word in ("-r", f"{old}:={new}")]
