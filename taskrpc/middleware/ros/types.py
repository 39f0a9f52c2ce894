"""The classes of ROS that belong to classes of a program, with the check that both are equal."""

from __future__ import annotations

from typing import Any

import srvgen
from taskrpc.errors import TypeMismatch
from taskrpc.middleware.ros.definitions import action_of_ros, message_of_ros, service_of_ros
from taskrpc.middleware.ros.installed import NotBuilt, action_part, ros_class
from taskrpc.spi import ServiceType


def ros_service(srv_type: ServiceType) -> Any:
    """Return ROS's class of a service. Raises NotBuilt, and TypeMismatch if it differs."""
    name = srv_type._TYPE
    ros = ros_class(name)
    _check(name, srv_type._HASH, _service(name)._HASH)
    return ros


def ros_message(msg_type: Any) -> Any:
    """Return ROS's class of a message. Raises NotBuilt, and TypeMismatch if it differs."""
    name = msg_type._TYPE
    ros = ros_class(name)
    action, part = action_part(name)
    made = _part(action, part) if action else message_of_ros(name, ros, ros_class)
    _check(name, msg_type._HASH, made._HASH)
    return ros


def our_service(type_name: str) -> Any:
    """Return our class of a service that ROS has built, or whose definition srvgen finds.

    Raises NotBuilt or srvgen.DefinitionError.
    """
    try:
        return _service(type_name)
    except NotBuilt as error:
        try:
            return srvgen.load(type_name)
        except srvgen.DefinitionError:
            raise error from None


def service_hash(type_name: str, request: str, response: str) -> str:
    """Return the hash of a service whose request and response have these hashes.

    If this program has no class with these hashes, the result names both of them.
    """
    try:
        found = our_service(type_name)
    except (NotBuilt, srvgen.DefinitionError):
        return ""
    ours = found.Request._HASH, found.Response._HASH
    if ours == (request, response):
        return str(found._HASH)
    return f"request {request}, response {response}"


def _service(type_name: str) -> Any:
    """Return our class with the definition that ROS has built for a service. Raises NotBuilt."""
    action, part = action_part(type_name)
    if action:
        return _part(action, part)
    return service_of_ros(type_name, ros_class(type_name), ros_class)


def _part(action: str, part: str) -> Any:
    """Return our class of a service or message that an action implies. Raises NotBuilt."""
    return getattr(action_of_ros(action, ros_class(action), ros_class).Impl, part)


def _check(type_name: str, ours: str, ros: str) -> None:
    if ours != ros:
        raise TypeMismatch(
            f"{type_name} differs from the definition that ROS has built: the program's is {ours},"
            f" ROS's is {ros}; use the same file, and build it again with `colcon build`"
        )
