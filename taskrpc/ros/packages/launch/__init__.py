"""Launch files: ROS's package `launch`, which starts and ends several programs together.

Start with `launch_service`, which executes the entities of a `launch_description`. `actions`,
`substitutions`, `conditions`, `events` and `event_handlers` have what launch files consist of.
`launch_ros` adds nodes; only that package knows anything of ROS.
"""

from taskrpc.ros.module_names import add_module_names, add_other_name

from . import (
    actions,
    conditions,
    event_handlers,
    events,
    frontend,
    launch_description_sources,
    launch_service,
    logging,
    substitutions,
    utilities,
)
from .action import Action
from .conditions import Condition
from .event import Event
from .event_handler import EventHandler
from .launch_context import LaunchContext
from .launch_description import LaunchDescription
from .launch_description_entity import (
    LaunchDescriptionEntity,
    SomeActionsType,
    SomeEntitiesType,
)
from .launch_description_source import InvalidLaunchFileError, LaunchDescriptionSource
from .launch_introspector import LaunchIntrospector
from .launch_service import LaunchService
from .some_substitutions_type import SomeSubstitutionsType, SomeSubstitutionsType_types_tuple
from .substitution import Substitution, SubstitutionFailure

__all__ = [
    "Action",
    "Condition",
    "Event",
    "EventHandler",
    "InvalidLaunchFileError",
    "LaunchContext",
    "LaunchDescription",
    "LaunchDescriptionEntity",
    "LaunchDescriptionSource",
    "LaunchIntrospector",
    "LaunchService",
    "SomeActionsType",
    "SomeEntitiesType",
    "SomeSubstitutionsType",
    "SomeSubstitutionsType_types_tuple",
    "Substitution",
    "SubstitutionFailure",
    "actions",
    "conditions",
    "event_handlers",
    "events",
    "frontend",
    "launch_description_sources",
    "launch_service",
    "logging",
    "substitutions",
    "utilities",
]

add_module_names(__name__)
add_other_name(__name__, "condition", "conditions")
add_other_name(__name__, "some_actions_type", "launch_description_entity")
add_other_name(__name__, "some_entities_type", "launch_description_entity")
