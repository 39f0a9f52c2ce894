"""The methods of a node that concern its parameters."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ...parameter import Parameter
from .callbacks import OnSetCallback, PostSetCallback, PreSetCallback
from .checks import RELATIVE_TOLERANCE
from .node_parameters import NodeParameters


class ParameterMethods:
    """The part of `Node` that passes calls on to its `NodeParameters`."""

    PARAM_REL_TOL = RELATIVE_TOLERANCE
    """The relative tolerance of floats at the ends and the steps of their range."""

    _rclpy_parameters: NodeParameters

    def _rclpy_keep(self, parameters: NodeParameters) -> None:
        """Keep the parameters, also under the private names of rclpy, which some programs use."""
        self._rclpy_parameters = parameters
        self._parameters = parameters.parameters
        self._descriptors = parameters.descriptors
        self._parameter_overrides = parameters.overrides
        self._parameter_event_publisher = parameters.event_publisher
        self._pre_set_parameters_callbacks = parameters.pre_set_callbacks
        self._on_set_parameters_callbacks = parameters.on_set_callbacks
        self._post_set_parameters_callbacks = parameters.post_set_callbacks
        self._parameters_callbacks = parameters.on_set_callbacks  # the name in ROS 2 Humble

    def declare_parameter(
        self,
        name: str,
        value: Any = None,
        descriptor: Any = None,
        ignore_override: bool = False,
    ) -> Parameter:
        """Declare a parameter by its default value, or by its type alone (`Parameter.Type.…`).

        An override from the command line, a file or the constructor takes precedence over the
        default. The type is fixed from now on, unless the descriptor has `dynamic_typing`.

        Raises:
            ParameterAlreadyDeclaredException: a parameter of this name is declared.
            InvalidParameterException: the name is empty.
            InvalidParameterTypeException: an override has another type.
            InvalidParameterValueException: the descriptor's range or a callback refuses the value.
        """
        return self._rclpy_parameters.declare_parameter(name, value, descriptor, ignore_override)

    def declare_parameters(
        self,
        namespace: str,
        parameters: Sequence[tuple[Any, ...]],
        ignore_override: bool = False,
    ) -> list[Parameter]:
        """Declare several: tuples of name, value or type, descriptor; the last two are optional.

        A namespace and a dot are put before every name. When one is refused, those before it stay
        declared. Raises as `declare_parameter` does, and TypeError for a tuple of
        another form.
        """
        return self._rclpy_parameters.declare_parameters(namespace, parameters, ignore_override)

    def undeclare_parameter(self, name: str) -> None:
        """Remove a parameter.

        Raises ParameterNotDeclaredException for an undeclared one, ParameterImmutableException for
        a read-only one.
        """
        self._rclpy_parameters.undeclare_parameter(name)

    def has_parameter(self, name: str) -> bool:
        """Whether a parameter is declared."""
        return self._rclpy_parameters.has_parameter(name)

    def get_parameter_types(self, names: Sequence[str]) -> list[Any]:
        """The types of parameters. Raises as `get_parameter_type` does."""
        return self._rclpy_parameters.get_parameter_types(names)

    def get_parameter_type(self, name: str) -> Any:
        """The number of the type of a parameter; NOT_SET for an undeclared one if allowed.

        Raises ParameterNotDeclaredException if they are not.
        """
        return self._rclpy_parameters.get_parameter_type(name)

    def get_parameters(self, names: Sequence[str]) -> list[Parameter]:
        """Several parameters. Raises as `get_parameter` does."""
        return self._rclpy_parameters.get_parameters(names)

    def get_parameter(self, name: str) -> Parameter:
        """A parameter; `.value` has its value.

        Raises ParameterNotDeclaredException unless undeclared ones are allowed, and
        ParameterUninitializedException for one that was declared by its type and never set.
        """
        return self._rclpy_parameters.get_parameter(name)

    def get_parameter_or(self, name: str, alternative_value: Parameter | None = None) -> Parameter:
        """A parameter, or the alternative if the parameter is not declared or not set."""
        return self._rclpy_parameters.get_parameter_or(name, alternative_value)

    def get_parameters_by_prefix(self, prefix: str) -> dict[str, Parameter]:
        """The parameters of a group by their names in it; all for an empty prefix."""
        return self._rclpy_parameters.get_parameters_by_prefix(prefix)

    def set_parameters(self, parameter_list: Sequence[Parameter]) -> list[Any]:
        """Set one after the other; the results say which were set, and why others were not.

        Raises ParameterNotDeclaredException at the first undeclared one, unless these are allowed.
        """
        return self._rclpy_parameters.set_parameters(parameter_list)

    def set_parameters_atomically(self, parameter_list: Sequence[Parameter]) -> Any:
        """Set all or none; the result says whether they were set, and why not.

        Raises ParameterNotDeclaredException for undeclared ones, unless these are allowed.
        """
        return self._rclpy_parameters.set_parameters_atomically(parameter_list)

    def list_parameters(self, prefixes: list[str], depth: int) -> Any:
        """The names of parameters and of their groups, as a ListParametersResult.

        Args:
            prefixes: only these parameters and groups; all if the list is empty.
            depth: how many levels to list below them; 0 for all.

        Raises:
            TypeError: the prefixes are not a list of names, or the depth is not a number.
            ValueError: the depth is negative.
        """
        return self._rclpy_parameters.list_parameters(prefixes, depth)

    def describe_parameter(self, name: str) -> Any:
        """The descriptor of a parameter; an empty one for an undeclared one if these are allowed.

        Raises ParameterNotDeclaredException if they are not.
        """
        return self._rclpy_parameters.describe_parameter(name)

    def describe_parameters(self, names: Sequence[str]) -> list[Any]:
        """Several descriptors. Raises as `describe_parameter` does."""
        return self._rclpy_parameters.describe_parameters(names)

    def set_descriptor(self, name: str, descriptor: Any, alternative_value: Any = None) -> Any:
        """Replace the descriptor of a parameter; returns its ParameterValue afterwards.

        Args:
            name: the name of the parameter; the name in the descriptor is ignored.
            descriptor: the rules for its values from now on.
            alternative_value: a ParameterValue to set if the present one does not fit.

        Raises:
            ParameterNotDeclaredException: it is not declared, and undeclared ones are not allowed.
            ParameterImmutableException: it is read-only.
            InvalidParameterValueException: neither value fits.
        """
        return self._rclpy_parameters.set_descriptor(name, descriptor, alternative_value)

    def add_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Add a callback that may change the parameters to set, before they are checked.

        It receives a list of parameters and returns the list to set instead. It runs for every
        setting and for no declaration.
        """
        self._rclpy_parameters.add_pre_set_parameters_callback(callback)

    def add_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """Add a callback that accepts or rejects values: it returns a SetParametersResult.

        It runs for every setting and declaration; the callback that was added last runs first.
        """
        self._rclpy_parameters.add_on_set_parameters_callback(callback)

    def add_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """Add a callback that receives the parameters that were set or declared."""
        self._rclpy_parameters.add_post_set_parameters_callback(callback)

    def remove_pre_set_parameters_callback(self, callback: PreSetCallback) -> None:
        """Remove a callback. Raises ValueError for one that was not added."""
        self._rclpy_parameters.remove_pre_set_parameters_callback(callback)

    def remove_on_set_parameters_callback(self, callback: OnSetCallback) -> None:
        """Remove a callback. Raises ValueError for one that was not added."""
        self._rclpy_parameters.remove_on_set_parameters_callback(callback)

    def remove_post_set_parameters_callback(self, callback: PostSetCallback) -> None:
        """Remove a callback. Raises ValueError for one that was not added."""
        self._rclpy_parameters.remove_post_set_parameters_callback(callback)
