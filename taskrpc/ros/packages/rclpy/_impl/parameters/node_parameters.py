"""The parameters of a node: declare, get, set, describe and list them, and publish changes."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import srvgen

from ...exceptions import (
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterAlreadyDeclaredException,
    ParameterImmutableException,
    ParameterNotDeclaredException,
    ParameterUninitializedException,
)
from ...parameter import PARAMETER_SEPARATOR_STRING, Parameter, parameter_value_to_python
from ...qos import qos_profile_parameter_events
from ..arguments import Arguments, overrides_of
from ..node_interface import NodeInterface
from . import checks
from .callbacks import ParameterCallbacks, SetParametersResult
from .declarations import ParameterDescriptor, declaration

ListParameters = srvgen.load("rcl_interfaces/srv/ListParameters")
ListParametersResult = srvgen.load("rcl_interfaces/msg/ListParametersResult")
ParameterEvent = srvgen.load("rcl_interfaces/msg/ParameterEvent")

PARAMETER_EVENTS = "/parameter_events"
"""The topic on which every node publishes the changes of its parameters."""


class NodeParameters(ParameterCallbacks):
    """The parameters of one node; `Node` documents the methods.

    Where ROS's method calls another method of the node, this class calls it on the node, too: a
    program may override it.
    """

    def __init__(
        self,
        node: NodeInterface,
        arguments: Sequence[Arguments],
        parameter_overrides: Iterable[Parameter] | None,
        allow_undeclared_parameters: bool,
    ) -> None:
        """Read the overrides of the command lines and of the constructor.

        Arguments that come later take precedence. The node must have its name and be able to
        create publishers.
        """
        super().__init__()
        self._node = node
        self.parameters: dict[str, Parameter] = {}
        self.descriptors: dict[str, Any] = {}
        self._allow_undeclared = allow_undeclared_parameters
        lines = [one.parameters for one in arguments]
        found = overrides_of(lines, self._node.get_fully_qualified_name())
        self.overrides = {name: Parameter(name, value=value) for name, value in found.items()}
        self.overrides.update({one.name: one for one in parameter_overrides or ()})
        self.event_publisher = self._node.create_publisher(
            ParameterEvent, PARAMETER_EVENTS, qos_profile_parameter_events
        )

    def declare_overrides(self) -> None:
        """Declare all overrides, for `automatically_declare_parameters_from_overrides`."""
        overrides = self.overrides.items()
        self._node.declare_parameters(
            "",
            [(name, one.value, ParameterDescriptor()) for name, one in overrides],
            ignore_override=True,
        )

    def declare_parameter(
        self,
        name: str,
        value: Any = None,
        descriptor: Any = None,
        ignore_override: bool = False,
    ) -> Parameter:
        """As `Node.declare_parameter`."""
        if value is None and descriptor is None:
            return self._node.declare_parameters("", [(name,)], ignore_override)[0]
        entry = (name, value, ParameterDescriptor() if descriptor is None else descriptor)
        return self._node.declare_parameters("", [entry], ignore_override)[0]

    def declare_parameters(
        self,
        namespace: str,
        parameters: Sequence[tuple[Any, ...]],
        ignore_override: bool = False,
    ) -> list[Parameter]:
        """As `Node.declare_parameters`."""
        declared = [declaration(index, one, namespace) for index, one in enumerate(parameters)]
        wanted = []
        for one in declared:
            overridden = not ignore_override and one.name in self.overrides
            value = self.overrides[one.name].value if overridden else one.value
            wanted.append(Parameter(one.name, value=value))
        if known := [one.name for one in wanted if one.name in self.parameters]:
            raise ParameterAlreadyDeclaredException(known)
        descriptors = {one.name: one.descriptor for one in declared}
        for parameter in wanted:
            self._declare(parameter, descriptors)
        return [self.parameters[one.name] for one in wanted]

    def _declare(self, parameter: Parameter, descriptors: Mapping[str, Any]) -> None:
        result = self._set_all([parameter], descriptors, keep_not_set=True)
        if result.successful:
            return
        if result.reason.startswith(checks.WRONG_TYPE):
            expected = Parameter.Type(descriptors[parameter.name].type).name
            raise InvalidParameterTypeException(parameter, expected)
        raise InvalidParameterValueException(parameter.name, parameter.value, result.reason)

    def undeclare_parameter(self, name: str) -> None:
        """As `Node.undeclare_parameter`."""
        if not self._node.has_parameter(name):
            raise ParameterNotDeclaredException(name)
        if self.descriptors[name].read_only:
            raise ParameterImmutableException(name)
        self._forget(name)

    def has_parameter(self, name: str) -> bool:
        """As `Node.has_parameter`."""
        return name in self.parameters

    def get_parameter_types(self, names: Sequence[str]) -> list[Any]:
        """As `Node.get_parameter_types`."""
        _check_names(names)
        return [self._node.get_parameter_type(name) for name in names]

    def get_parameter_type(self, name: str) -> Any:
        """As `Node.get_parameter_type`."""
        if self._node.has_parameter(name):
            return self.parameters[name].type_.value
        if self._allow_undeclared:
            return Parameter.Type.NOT_SET
        raise ParameterNotDeclaredException(name)

    def get_parameters(self, names: Sequence[str]) -> list[Parameter]:
        """As `Node.get_parameters`."""
        _check_names(names)
        return [self._node.get_parameter(name) for name in names]

    def get_parameter(self, name: str) -> Parameter:
        """As `Node.get_parameter`."""
        if not self._node.has_parameter(name):
            if self._allow_undeclared:
                return Parameter(name)
            raise ParameterNotDeclaredException(name)
        parameter = self.parameters[name]
        if parameter.type_ == Parameter.Type.NOT_SET and not self.descriptors[name].dynamic_typing:
            raise ParameterUninitializedException(name)
        return parameter

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """As `Node.get_parameter_or`."""
        found = self.parameters.get(name)
        if found is not None and found.type_ != Parameter.Type.NOT_SET:
            return found
        return Parameter(name) if alternative_value is None else alternative_value

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """As `Node.get_parameters_by_prefix`."""
        start = prefix + PARAMETER_SEPARATOR_STRING if prefix else ""
        return {
            name.removeprefix(start): parameter
            for name, parameter in list(self.parameters.items())
            if name.startswith(start)
        }

    def set_parameters(self, parameter_list: Sequence[Parameter]) -> list[Any]:
        """As `Node.set_parameters`."""
        return [self._node.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: Sequence[Parameter]) -> Any:
        """As `Node.set_parameters_atomically`."""
        wanted = list(parameter_list)
        if self.pre_set_callbacks:
            before = [callback(wanted) for callback in self.pre_set_callbacks]
            wanted = [parameter for changed in before for parameter in changed]
            if not wanted:
                return _refused(
                    "parameter list cannot be empty, this might be due to "
                    "pre_set_parameters_callback modifying the original parameters list."
                )
        if not all(isinstance(parameter, Parameter) for parameter in wanted):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        undeclared = [one.name for one in wanted if one.name not in self.parameters]
        if undeclared and not self._allow_undeclared:
            raise ParameterNotDeclaredException(undeclared)
        return self._set_all(wanted)

    def _set_all(
        self,
        parameters: list[Parameter],
        descriptors: Mapping[str, Any] | None = None,
        keep_not_set: bool = False,
    ) -> Any:
        """Set all or none, with new descriptors if given; then publish the change."""
        for parameter in parameters:
            if reason := self._refusal(parameter, descriptors):
                return _refused(reason)
        if (result := self._rejection(parameters)) is not None:
            return result
        event = ParameterEvent(node=self._node.get_fully_qualified_name())
        for parameter in parameters:
            if parameter.type_ == Parameter.Type.NOT_SET and not keep_not_set:
                event.deleted_parameters.append(parameter.to_parameter_msg())
                self._forget(parameter.name)
            else:
                is_new = self._node.get_parameter_or(parameter.name).type_ == Parameter.Type.NOT_SET
                changes = event.new_parameters if is_new else event.changed_parameters
                changes.append(parameter.to_parameter_msg())
                self._keep(parameter, descriptors)
        event.stamp = self._node.get_clock().now().to_msg()
        self.event_publisher.publish(event)
        for after in self.post_set_callbacks:
            after(parameters)
        return SetParametersResult(successful=True)

    def _refusal(self, parameter: Parameter, descriptors: Mapping[str, Any] | None) -> str:
        known = self.descriptors if descriptors is None else descriptors
        descriptor = known.get(parameter.name)
        if descriptor is None:
            return ""
        descriptor.name = parameter.name
        declared = self._node.has_parameter(parameter.name)
        return checks.refusal(parameter, descriptor, declared, changes=descriptors is None)

    def _keep(self, parameter: Parameter, descriptors: Mapping[str, Any] | None) -> None:
        name = parameter.name
        if descriptors is not None:
            self.descriptors[name] = descriptors[name]
        elif name not in self.descriptors:
            self.descriptors[name] = ParameterDescriptor(dynamic_typing=True)
        self.parameters[name] = parameter

    def _forget(self, name: str) -> None:
        self.parameters.pop(name, None)
        self.descriptors.pop(name, None)

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """As `Node.list_parameters`."""
        return listed(
            list(self.parameters), prefixes, depth
        )  # a copy: other threads may declare parameters

    def describe_parameter(self, name: str) -> Any:
        """As `Node.describe_parameter`."""
        if name in self.descriptors:
            return self.descriptors[name]
        if self._allow_undeclared:
            return ParameterDescriptor()
        raise ParameterNotDeclaredException(name)

    def describe_parameters(self, names: Sequence[str]) -> list[Any]:
        """As `Node.describe_parameters`."""
        return [self._node.describe_parameter(name) for name in names]

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """As `Node.set_descriptor`."""
        if not self._node.has_parameter(name):
            if self._allow_undeclared:
                return self._node.get_parameter(name).get_parameter_value()
            raise ParameterNotDeclaredException(name)
        if self._node.describe_parameter(name).read_only:
            raise ParameterImmutableException(name)
        parameter = self._node.get_parameter(name)
        if reason := self._misfit(parameter, descriptor):
            if alternative_value is not None:
                parameter = Parameter(name, value=parameter_value_to_python(alternative_value))
                reason = self._misfit(parameter, descriptor)
            if reason:
                raise InvalidParameterValueException(name, parameter.value, reason)
        self.parameters[name], self.descriptors[name] = parameter, descriptor
        return self._node.get_parameter(name).get_parameter_value()

    def _misfit(self, parameter: Parameter, descriptor: Any) -> str:
        return self._refusal(parameter, {parameter.name: descriptor})


def _refused(reason: str) -> Any:
    return SetParametersResult(successful=False, reason=reason)


def _check_names(names: Sequence[str]) -> None:
    if not all(isinstance(name, str) for name in names):
        raise TypeError("All names must be instances of type str")


def listed(names: Iterable[str], prefixes: object, depth: object) -> Any:
    """The names that match `list_parameters`, with their groups. Raises TypeError, ValueError."""
    groups, levels = _checked(prefixes, depth)
    result = ListParametersResult()
    for name in names:
        if _is_listed(name, groups, levels):
            result.names.append(name)
            group, separator, _ = name.rpartition(PARAMETER_SEPARATOR_STRING)
            if separator and group not in result.prefixes:
                result.prefixes.append(group)
    return result


def _checked(prefixes: object, depth: object) -> tuple[list[str], int]:
    """The prefixes and the depth. Raises TypeError, ValueError."""
    if not isinstance(prefixes, list):
        raise TypeError("The prefixes argument must be a list")
    if not all(isinstance(prefix, str) for prefix in prefixes):
        raise TypeError("All prefixes must be instances of type str")
    if not isinstance(depth, int):
        raise TypeError("The depth must be instance of type int")
    if depth < 0:
        raise ValueError("The depth must be greater than or equal to zero")
    return prefixes, depth


def _is_listed(name: str, prefixes: list[str], depth: int) -> bool:
    """Whether a name is one of the prefixes, or at most `depth` levels below one."""
    if not prefixes:
        return _is_within(name, depth)
    for prefix in prefixes:
        below = name.removeprefix(prefix + PARAMETER_SEPARATOR_STRING)
        if name == prefix or (below != name and _is_within(below, depth)):
            return True
    return False


def _is_within(name: str, depth: int) -> bool:
    return (
        depth == ListParameters.Request.DEPTH_RECURSIVE
        or name.count(PARAMETER_SEPARATOR_STRING) < depth
    )
