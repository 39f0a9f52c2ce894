"""Actions: goals that take time, with feedback and a result.

Start with `client` and `server`; each is one waitable, which the executor queries as one entity.
Goal states, names and messages are those of `taskrpc.actions`, so both APIs understand each other.
"""

from .client import ActionClient
from .graph import (
    get_action_client_names_and_types_by_node,
    get_action_names_and_types,
    get_action_server_names_and_types_by_node,
)
from .server import ActionServer, CancelResponse, GoalResponse

__all__ = [
    "ActionClient",
    "ActionServer",
    "CancelResponse",
    "GoalResponse",
    "get_action_client_names_and_types_by_node",
    "get_action_names_and_types",
    "get_action_server_names_and_types_by_node",
]
