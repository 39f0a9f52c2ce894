"""The elements and substitutions of ROS in XML and YAML launch files."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any

from launch.frontend import elements
from launch.frontend.elements import Entities, base, given, process_arguments, split, text
from launch.frontend.expose import action_parsers, substitution_parsers
from launch.utilities.type_utils import coerce_to_type

from . import substitutions as s
from .actions import not_here, settings
from .actions.lifecycle import LifecycleNode
from .actions.node import Node
from .descriptions import ComposableNode
from .parameter_descriptions import ParameterFile, ParameterValue

_TYPES = {
    "str": str,
    "int": int,
    "float": float,
    "bool": bool,
    "list_of_str": list,
    "list_of_int": list,
    "list_of_float": list,
    "list_of_bool": list,
}


@functools.cache
def register() -> None:
    """Add the elements and substitutions to the tables."""
    for name, build in _ELEMENTS.items():
        action_parsers.setdefault(name, build)
    for name, make in _SUBSTITUTIONS.items():
        substitution_parsers.setdefault(name, make)


def _node_arguments(entity: Any, parser: Any) -> dict[str, Any]:
    args, ros_args = text(entity, parser, "args"), text(entity, parser, "ros_args")
    remaps = entity.get_attr("remap", data_type=Entities, optional=True) or ()
    params = entity.get_attr("param", data_type=Entities, optional=True) or ()
    return {
        "executable": parser.parse_substitution(entity.get_attr("exec")),
        "parameters": _parameters(params, parser),
        "remappings": [_rule(each, parser) for each in remaps],
        **given(
            package=text(entity, parser, "pkg"),
            name=text(entity, parser, "name"),
            exec_name=text(entity, parser, "exec_name"),
            namespace=text(entity, parser, "namespace"),
            arguments=None if args is None else split(args),
            ros_arguments=None if ros_args is None else split(ros_args),
        ),
        **process_arguments(entity, parser),
    }


def _rule(entity: Any, parser: Any) -> tuple[Any, Any]:
    parse = parser.parse_substitution
    return parse(entity.get_attr("from")), parse(entity.get_attr("to"))


def _parameters(params: Any, parser: Any) -> list[Any]:
    """Dicts of the parameters, and the files, in their order."""
    found: list[Any] = []
    for each in params:
        file = each.get_attr("from", optional=True)
        if file is None:
            found.append(_nested([each], parser))
            continue
        allow = each.get_attr("allow_substs", optional=True)
        substs = False if allow is None else parser.parse_substitution(allow)
        found.append(ParameterFile(parser.parse_substitution(file), allow_substs=substs))
    return found


def _nested(params: Any, parser: Any) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for each in params:
        name = each.get_attr("name")
        inner = each.get_attr("param", data_type=Entities, optional=True)
        value = each.get_attr("value", data_type=None, optional=True)
        if (value is None) == (inner is None):
            raise RuntimeError("either a value attribute or nested params are needed")
        kind = each.get_attr("type", optional=True)
        separator = each.get_attr("value-sep", optional=True) or each.get_attr("sep", optional=True)
        if inner is not None:
            found.setdefault(name, {}).update(_nested(inner, parser))
        elif separator is not None:
            found[name] = [coerce_to_type(part) for part in str(value).split(separator)]
        else:
            parsed = parser.parse_if_substitutions(value)
            found[name] = parsed
            if kind is not None:
                if kind not in _TYPES:
                    raise ValueError(f"expected one of {', '.join(_TYPES)} as type, got '{kind}'")
                found[name] = ParameterValue(parsed, value_type=_TYPES[kind])
        each.assert_entity_completely_parsed()
    return found


def _node(entity: Any, parser: Any) -> Any:
    return Node(**_node_arguments(entity, parser))


def _lifecycle_node(entity: Any, parser: Any) -> Any:
    autostart = entity.get_attr("autostart", data_type=bool, optional=True)
    return LifecycleNode(autostart=bool(autostart), **_node_arguments(entity, parser))


def _components(entity: Any, parser: Any) -> list[ComposableNode]:
    parse = parser.parse_substitution
    children = entity.get_attr("composable_node", data_type=Entities, optional=True) or ()
    return [
        ComposableNode(package=parse(each.get_attr("pkg")), plugin=parse(each.get_attr("plugin")))
        for each in children
    ]


def _container(entity: Any, parser: Any) -> Any:
    for name in ("pkg", "exec", "args", "ros_args", "namespace", "exec_name"):
        entity.get_attr(name, optional=True)
    for name in ("param", "remap"):
        entity.get_attr(name, data_type=Entities, optional=True)
    return not_here.ComposableNodeContainer(
        name=text(entity, parser, "name") or "",
        composable_node_descriptions=_components(entity, parser),
        condition=process_arguments(entity, parser).get("condition"),
    )


def _load(entity: Any, parser: Any) -> Any:
    return not_here.LoadComposableNodes(
        target_container=text(entity, parser, "target"),
        composable_node_descriptions=_components(entity, parser),
        **base(entity, parser),
    )


def _one(action: Any, name: str) -> Any:
    """An element with one attribute."""

    def build(entity: Any, parser: Any) -> Any:
        value = parser.parse_substitution(entity.get_attr(name))
        return action(value, **base(entity, parser))

    return build


def _set_parameter(entity: Any, parser: Any) -> Any:
    value = parser.parse_if_substitutions(entity.get_attr("value", data_type=None))
    name = parser.parse_substitution(entity.get_attr("name"))
    return settings.SetParameter(name, value, **base(entity, parser))


def _set_remap(entity: Any, parser: Any) -> Any:
    return settings.SetRemap(*_rule(entity, parser), **base(entity, parser))


_ELEMENTS: dict[str, Callable[..., Any]] = {
    "node": _node,
    "lifecycle_node": _lifecycle_node,
    "node_container": _container,
    "load_composable_node": _load,
    "push_ros_namespace": _one(settings.PushROSNamespace, "namespace"),
    "set_parameter": _set_parameter,
    "set_parameters_from_file": _one(settings.SetParametersFromFile, "filename"),
    "set_remap": _set_remap,
    "set_use_sim_time": _one(settings.SetUseSimTime, "value"),
    "set_ros_log_dir": _one(settings.SetROSLogDir, "value"),
    "ros_timer": elements.action_of("timer"),
}


def _param(name: Any, default: Any = None) -> Any:
    return s.Parameter(name, default=default)


_SUBSTITUTIONS: dict[str, Callable[..., Any]] = {
    "find-pkg-share": s.FindPackageShare,
    "find-pkg-prefix": s.FindPackagePrefix,
    "exec-in-pkg": s.ExecutableInPackage,
    "param": _param,
}
