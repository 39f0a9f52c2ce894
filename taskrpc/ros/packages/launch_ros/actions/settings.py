"""Actions that change all nodes that start later: namespaces, parameters, remappings."""

from __future__ import annotations

from typing import Any

from launch.action import Action
from launch.substitution import normalize_to_list_of_substitutions, perform, perform_substitutions

from ..parameter_descriptions import Parameter
from ..parameters import NAMESPACE, PARAMETERS, REMAPPINGS, joined_namespace


class PushROSNamespace(Action):
    """Adds a namespace to the nodes that start later in this scope."""

    def __init__(self, namespace: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._namespace = normalize_to_list_of_substitutions(namespace)

    @property
    def namespace(self) -> Any:
        """The namespace, before it is computed."""
        return self._namespace

    def execute(self, context: Any) -> list[Any] | None:
        """Add the namespace."""
        known = context.launch_configurations
        inner = perform_substitutions(context, self._namespace)
        known[NAMESPACE] = joined_namespace(known.get(NAMESPACE, ""), inner)
        return None


PushRosNamespace = PushROSNamespace


class SetParameter(Action):
    """Sets a parameter of the nodes that start later in this scope."""

    def __init__(self, name: Any, value: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._parameter = Parameter(name, value)

    @property
    def name(self) -> Any:
        """The name, before it is computed."""
        return self._parameter.name

    @property
    def value(self) -> Any:
        """The value, before it is computed."""
        return self._parameter.value

    def execute(self, context: Any) -> list[Any] | None:
        """Set the parameter."""
        name, value = self._parameter.evaluate(context)
        known = context.launch_configurations
        before = [each for each in known.get(PARAMETERS, ()) if each[0] != name]
        # A new list: scopes keep the old one.
        known[PARAMETERS] = [*before, (name, value)]
        return None


class SetUseSimTime(SetParameter):
    """Sets `use_sim_time` of the nodes that start later in this scope."""

    def __init__(self, value: Any, **kwargs: Any) -> None:
        super().__init__("use_sim_time", value, **kwargs)


class SetParametersFromFile(Action):
    """Gives a parameter file to the nodes that start later in this scope."""

    def __init__(self, filename: Any, node_name: Any = None, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._filename = normalize_to_list_of_substitutions(filename)

    def execute(self, context: Any) -> list[Any] | None:
        """Add the file."""
        known = context.launch_configurations
        name = perform_substitutions(context, self._filename)
        known[PARAMETERS] = [*known.get(PARAMETERS, ()), name]
        return None


class SetRemap(Action):
    """Adds a remapping to the nodes that start later in this scope."""

    def __init__(self, src: Any, dst: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._src, self._dst = src, dst

    @property
    def src(self) -> Any:
        """The old name, before it is computed."""
        return self._src

    @property
    def dst(self) -> Any:
        """The new name, before it is computed."""
        return self._dst

    def execute(self, context: Any) -> list[Any] | None:
        """Add the rule."""
        known = context.launch_configurations
        rule = (perform(context, self._src), perform(context, self._dst))
        known[REMAPPINGS] = [*known.get(REMAPPINGS, ()), rule]
        return None


class SetROSLogDir(Action):
    """Sets the folder of ROS's log files for the programs that start later."""

    def __init__(self, new_log_dir: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._folder = normalize_to_list_of_substitutions(new_log_dir)

    def execute(self, context: Any) -> list[Any] | None:
        """Set the folder."""
        context.environment["ROS_LOG_DIR"] = perform_substitutions(context, self._folder)
        return None
