"""The types that a program gives: refused where they are something else."""

from __future__ import annotations

from typing import Any


def service_type(srv_type: Any) -> Any:
    """The same, if it is a service's. Raises TypeError."""
    if not (hasattr(srv_type, "Request") and hasattr(srv_type, "_HASH")):
        kind = f"the class {srv_type.__name__}" if isinstance(srv_type, type) else repr(srv_type)
        raise TypeError(
            f"expected a service type such as srvgen.load('std_srvs/srv/Trigger'), got {kind}"
        )
    return srv_type


def message_type(msg_type: Any) -> Any:
    """The same, if it is a message's. Raises TypeError."""
    if hasattr(msg_type, "Request") or not hasattr(msg_type, "_HASH"):
        kind = f"the class {msg_type.__name__}" if isinstance(msg_type, type) else repr(msg_type)
        raise TypeError(
            f"expected a message type such as srvgen.load('std_msgs/msg/String'), got {kind}"
        )
    return msg_type
