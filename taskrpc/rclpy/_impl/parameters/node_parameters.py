"""What a node does with parameters: declares, gets, sets, describes, and tells of changes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

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
from . import checks
from .callbacks import ParameterCallbacks
from .declarations import ParameterDescriptor, declaration
from .listing import listed

if TYPE_CHECKING:
    from ...clock import Clock

ParameterEvent = srvgen.load("rcl_interfaces/msg/ParameterEvent")
SetParametersResult = srvgen.load("rcl_interfaces/msg/SetParametersResult")

PARAMETER_EVENTS = "/parameter_events"
"""Where every node tells of its parameters' changes."""


class NodeParameters(ParameterCallbacks):
    """The part of a node that is about parameters. Nodes call `_init_parameters` first."""

    PARAM_REL_TOL = checks.RELATIVE_TOLERANCE
    """By how much a float may miss the ends and the steps of its range."""

    get_fully_qualified_name: Callable[[], str]
    create_publisher: Callable[..., Any]
    get_clock: Callable[[], Clock]

    def _init_parameters(
        self,
        arguments: Sequence[Arguments],
        parameter_overrides: Iterable[Parameter] | None,
        allow_undeclared_parameters: bool,
    ) -> None:
        """Begin with the overrides of command lines, the program's first, and of the constructor.

        The node's name is known by then. Afterwards `_declare_overrides`, if that is wanted.
        """
        self._parameters: dict[str, Parameter] = {}
        self._descriptors: dict[str, Any] = {}
        self._allow_undeclared_parameters = allow_undeclared_parameters
        self._init_callbacks()
        lines = [one.parameters for one in arguments]
        found = overrides_of(lines, self.get_fully_qualified_name())
        self._parameter_overrides = {
            name: Parameter(name, value=value) for name, value in found.items()
        }
        self._parameter_overrides.update({one.name: one for one in parameter_overrides or ()})
        self._parameter_event_publisher = self.create_publisher(
            ParameterEvent, PARAMETER_EVENTS, qos_profile_parameter_events
        )

    def _declare_overrides(self) -> None:
        """Declare what the overrides name: `automatically_declare_parameters_from_overrides`."""
        overrides = self._parameter_overrides.items()
        self.declare_parameters(
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
        """Declare a parameter by its default value, or by its type alone (`Parameter.Type.…`).

        An override from the command line, a file or the node's constructor comes before the
        default. From now on the type stays, unless the descriptor has `dynamic_typing`.

        Raises:
            ParameterAlreadyDeclaredException: there is one of this name.
            InvalidParameterException: the name is empty.
            InvalidParameterTypeException: an override has another type.
            InvalidParameterValueException: the descriptor's range or a callback refuses the value.
        """
        if value is None and descriptor is None:
            return self.declare_parameters("", [(name,)], ignore_override)[0]
        entry = (name, value, ParameterDescriptor() if descriptor is None else descriptor)
        return self.declare_parameters("", [entry], ignore_override)[0]

    def declare_parameters(
        self,
        namespace: str,
        parameters: Sequence[tuple[Any, ...]],
        ignore_override: bool = False,
    ) -> list[Parameter]:
        """Declare several: tuples of name, value or type, descriptor; the last two may lack.

        With a namespace, its name and a dot go in front of every name. Those before one that is
        refused stay declared. Raises as `declare_parameter` does, and TypeError for a tuple of
        another form.
        """
        declared = [declaration(index, one, namespace) for index, one in enumerate(parameters)]
        wanted = []
        for one in declared:
            overridden = not ignore_override and one.name in self._parameter_overrides
            value = self._parameter_overrides[one.name].value if overridden else one.value
            wanted.append(Parameter(one.name, value=value))
        if known := [one.name for one in wanted if one.name in self._parameters]:
            raise ParameterAlreadyDeclaredException(known)
        descriptors = {one.name: one.descriptor for one in declared}
        for parameter in wanted:
            self._rclpy_declare(parameter, descriptors)
        return [self._parameters[one.name] for one in wanted]

    def _rclpy_declare(self, parameter: Parameter, descriptors: Mapping[str, Any]) -> None:
        result = self._set_all([parameter], descriptors, keep_not_set=True)
        if result.successful:
            return
        if result.reason.startswith(checks.WRONG_TYPE):
            expected = Parameter.Type(descriptors[parameter.name].type).name
            raise InvalidParameterTypeException(parameter, expected)
        raise InvalidParameterValueException(parameter.name, parameter.value, result.reason)

    def undeclare_parameter(self, name: str) -> None:
        """Forget a parameter.

        Raises ParameterNotDeclaredException where there is none, ParameterImmutableException for
        a read-only one.
        """
        if not self.has_parameter(name):
            raise ParameterNotDeclaredException(name)
        if self._descriptors[name].read_only:
            raise ParameterImmutableException(name)
        self._rclpy_forget(name)

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter is declared."""
        return name in self._parameters

    def get_parameter_types(self, names: Sequence[str]) -> list[Any]:
        """The types of parameters. Raises as `get_parameter_type` does."""
        _check_names(names)
        return [self.get_parameter_type(name) for name in names]

    def get_parameter_type(self, name: str) -> Any:
        """The number of a parameter's type; NOT_SET for an undeclared one where that is allowed.

        Raises ParameterNotDeclaredException where it is not.
        """
        if self.has_parameter(name):
            return self._parameters[name].type_.value
        if self._allow_undeclared_parameters:
            return Parameter.Type.NOT_SET
        raise ParameterNotDeclaredException(name)

    def get_parameters(self, names: Sequence[str]) -> list[Parameter]:
        """Several parameters. Raises as `get_parameter` does."""
        _check_names(names)
        return [self.get_parameter(name) for name in names]

    def get_parameter(self, name: str) -> Parameter:
        """A parameter; its `.value` is what it is set to.

        Raises ParameterNotDeclaredException unless undeclared ones are allowed, and
        ParameterUninitializedException for one that was declared by its type and never set.
        """
        if not self.has_parameter(name):
            if self._allow_undeclared_parameters:
                return Parameter(name)
            raise ParameterNotDeclaredException(name)
        parameter = self._parameters[name]
        if parameter.type_ == Parameter.Type.NOT_SET and not self._descriptors[name].dynamic_typing:
            raise ParameterUninitializedException(name)
        return parameter

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """A parameter, or the alternative where it is not declared or not set."""
        found = self._parameters.get(name)
        if found is not None and found.type_ != Parameter.Type.NOT_SET:
            return found
        return Parameter(name) if alternative_value is None else alternative_value

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """The parameters of a group by their names in it; all for an empty prefix."""
        start = prefix + PARAMETER_SEPARATOR_STRING if prefix else ""
        return {
            name.removeprefix(start): parameter
            for name, parameter in list(self._parameters.items())
            if name.startswith(start)
        }

    def set_parameters(self, parameter_list: Sequence[Parameter]) -> list[Any]:
        """Set one after the other; the answers say which could be set, and why not.

        Raises ParameterNotDeclaredException at the first undeclared one, unless these are allowed.
        """
        return [self.set_parameters_atomically([parameter]) for parameter in parameter_list]

    def set_parameters_atomically(self, parameter_list: Sequence[Parameter]) -> Any:
        """Set all or none; the answer says whether, and why not.

        Raises ParameterNotDeclaredException for undeclared ones, unless these are allowed.
        """
        wanted = list(parameter_list)
        if self._pre_set_parameters_callbacks:
            before = [callback(wanted) for callback in self._pre_set_parameters_callbacks]
            wanted = [parameter for changed in before for parameter in changed]
            if not wanted:
                return _refused(
                    "parameter list cannot be empty, this might be due to "
                    "pre_set_parameters_callback modifying the original parameters list."
                )
        if not all(isinstance(parameter, Parameter) for parameter in wanted):
            raise TypeError(f"parameter must be instance of type '{Parameter!r}'")
        undeclared = [one.name for one in wanted if one.name not in self._parameters]
        if undeclared and not self._allow_undeclared_parameters:
            raise ParameterNotDeclaredException(undeclared)
        return self._set_all(wanted)

    def _set_all(
        self,
        parameters: list[Parameter],
        descriptors: Mapping[str, Any] | None = None,
        keep_not_set: bool = False,
    ) -> Any:
        """Set all or none, with new descriptors where given; then tell of it."""
        for parameter in parameters:
            if reason := self._refusal(parameter, descriptors):
                return _refused(reason)
        if (result := self._verdict(parameters)) is not None:
            return result
        event = ParameterEvent(node=self.get_fully_qualified_name())
        for parameter in parameters:
            if parameter.type_ == Parameter.Type.NOT_SET and not keep_not_set:
                event.deleted_parameters.append(parameter.to_parameter_msg())
                self._rclpy_forget(parameter.name)
            else:
                is_new = self.get_parameter_or(parameter.name).type_ == Parameter.Type.NOT_SET
                told = event.new_parameters if is_new else event.changed_parameters
                told.append(parameter.to_parameter_msg())
                self._rclpy_keep(parameter, descriptors)
        event.stamp = self.get_clock().now().to_msg()
        self._parameter_event_publisher.publish(event)
        for after in self._post_set_parameters_callbacks:
            after(parameters)
        return SetParametersResult(successful=True)

    def _refusal(self, parameter: Parameter, descriptors: Mapping[str, Any] | None) -> str:
        known = self._descriptors if descriptors is None else descriptors
        descriptor = known.get(parameter.name)
        if descriptor is None:
            return ""
        descriptor.name = parameter.name
        declared = self.has_parameter(parameter.name)
        return checks.refusal(parameter, descriptor, declared, changes=descriptors is None)

    def _rclpy_keep(self, parameter: Parameter, descriptors: Mapping[str, Any] | None) -> None:
        name = parameter.name
        if descriptors is not None:
            self._descriptors[name] = descriptors[name]
        elif name not in self._descriptors:
            self._descriptors[name] = ParameterDescriptor(dynamic_typing=True)
        self._parameters[name] = parameter

    def _rclpy_forget(self, name: str) -> None:
        self._parameters.pop(name, None)
        self._descriptors.pop(name, None)

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """The names of parameters and of their groups, as a ListParametersResult.

        Args:
            prefixes: only these and what is in these groups; all where there is none.
            depth: how many names deep to look below them; 0 for all.

        Raises:
            TypeError: the prefixes are no list of names, or the depth is no number.
            ValueError: the depth is negative.
        """
        return listed(list(self._parameters), prefixes, depth)  # others may declare meanwhile

    def describe_parameter(self, name: str) -> Any:
        """A parameter's descriptor; an empty one for an undeclared one where that is allowed.

        Raises ParameterNotDeclaredException where it is not.
        """
        if name in self._descriptors:
            return self._descriptors[name]
        if self._allow_undeclared_parameters:
            return ParameterDescriptor()
        raise ParameterNotDeclaredException(name)

    def describe_parameters(self, names: Sequence[str]) -> list[Any]:
        """Several descriptors. Raises as `describe_parameter` does."""
        return [self.describe_parameter(name) for name in names]

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Give a parameter another descriptor; its ParameterValue afterwards comes back.

        Args:
            name: of the parameter; that in the descriptor is ignored.
            descriptor: what its values must fit from now on.
            alternative_value: a ParameterValue to set where the present one does not fit.

        Raises:
            ParameterNotDeclaredException: there is none, and undeclared ones are not allowed.
            ParameterImmutableException: it is read-only.
            InvalidParameterValueException: neither value fits.
        """
        if not self.has_parameter(name):
            if self._allow_undeclared_parameters:
                return self.get_parameter(name).get_parameter_value()
            raise ParameterNotDeclaredException(name)
        if self.describe_parameter(name).read_only:
            raise ParameterImmutableException(name)
        parameter = self.get_parameter(name)
        if reason := self._misfit(parameter, descriptor):
            if alternative_value is not None:
                parameter = Parameter(name, value=parameter_value_to_python(alternative_value))
                reason = self._misfit(parameter, descriptor)
            if reason:
                raise InvalidParameterValueException(name, parameter.value, reason)
        self._parameters[name], self._descriptors[name] = parameter, descriptor
        return self.get_parameter(name).get_parameter_value()

    def _misfit(self, parameter: Parameter, descriptor: Any) -> str:
        return self._refusal(parameter, {parameter.name: descriptor})


def _refused(reason: str) -> Any:
    return SetParametersResult(successful=False, reason=reason)


def _check_names(names: Sequence[str]) -> None:
    if not all(isinstance(name, str) for name in names):
        raise TypeError("All names must be instances of type str")
