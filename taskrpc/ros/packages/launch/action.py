"""The base class of actions."""

from __future__ import annotations

from typing import Any

from .conditions import Condition, IfCondition, UnlessCondition
from .launch_context import LaunchContext
from .launch_description_entity import LaunchDescriptionEntity
from .utilities.locations import location_of_caller, remember_location


class Action(LaunchDescriptionEntity):
    """Something that a launch file does. The launch executes its actions one after the other."""

    _location = ""
    """The line of the launch file that created the action; "" if no file in Python did."""

    def __init__(self, *, condition: Condition | None = None) -> None:
        if condition is not None and not isinstance(condition, Condition):
            raise TypeError(
                f"condition: expected one such as IfCondition('true'), got {condition!r}"
            )
        self._condition = condition
        self._location = location_of_caller()

    @property
    def condition(self) -> Condition | None:
        """The condition under which the action is executed."""
        return self._condition

    @classmethod
    def parse(cls, entity: Any, parser: Any) -> tuple[type[Any], dict[str, Any]]:
        """The class and the arguments for an element of an XML or YAML launch file."""
        wanted = entity.get_attr("if", optional=True)
        unwanted = entity.get_attr("unless", optional=True)
        if wanted is not None and unwanted is not None:
            raise RuntimeError("if and unless conditions can't be used simultaneously")
        found: dict[str, Any] = {}
        if wanted is not None:
            found["condition"] = IfCondition(parser.parse_substitution(wanted))
        elif unwanted is not None:
            found["condition"] = UnlessCondition(parser.parse_substitution(unwanted))
        return cls, found

    def visit(self, context: LaunchContext) -> list[LaunchDescriptionEntity] | None:
        """Execute the action if its condition holds."""
        try:
            if self._condition is None or self._condition.evaluate(context):
                return self.execute(context)
        except Exception as error:
            remember_location(error, self._location)
            raise
        return None

    def execute(self, context: LaunchContext) -> list[Any] | None:
        """Do the work of the action; return the entities that the launch executes next."""
        return None
