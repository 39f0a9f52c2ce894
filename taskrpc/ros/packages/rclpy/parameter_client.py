"""Get and set the parameters of another node."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, TypeAlias

from .callback_groups import CallbackGroup
from .parameter import Parameter, parameter_dict_from_yaml_file
from .parameter_service import (
    DescribeParameters,
    GetParameters,
    GetParameterTypes,
    ListParameters,
    SetParameters,
    SetParametersAtomically,
)
from .qos import QoSProfile, qos_profile_parameter_events, qos_profile_services_default
from .task import Future

if TYPE_CHECKING:
    from .client import Client
    from .node import Node
    from .subscription import Subscription

Done: TypeAlias = Callable[[Future[Any]], object]

_POLL_INTERVAL = 0.05
"""Seconds between two checks while a program waits for the services."""


class AsyncParameterClient:
    """Calls the parameter services of one node; futures complete while a thread spins `node`.

    Args:
        node: creates the clients.
        remote_node_name: the node that has the parameters, such as `robot` or `/ns/robot`.
        qos_profile: the profile of the clients.
        callback_group: the callback group of the clients.
    """

    def __init__(
        self,
        node: Node,
        remote_node_name: str,
        qos_profile: QoSProfile = qos_profile_services_default,
        callback_group: CallbackGroup | None = None,
    ) -> None:
        self.remote_node_name = remote_node_name
        self.node = node

        def client(srv_type: Any, name: str) -> Client[Any, Any]:
            return node.create_client(
                srv_type,
                f"{remote_node_name}/{name}",
                qos_profile=qos_profile,
                callback_group=callback_group,
            )

        self._get_parameter_client = client(GetParameters, "get_parameters")
        self._list_parameter_client = client(ListParameters, "list_parameters")
        self._set_parameter_client = client(SetParameters, "set_parameters")
        self._get_parameter_types_client = client(GetParameterTypes, "get_parameter_types")
        self._describe_parameters_client = client(DescribeParameters, "describe_parameters")
        self._set_parameters_atomically_client = client(
            SetParametersAtomically, "set_parameters_atomically"
        )

    def services_are_ready(self) -> bool:
        """Whether the node offers all six services."""
        return all(client.service_is_ready() for client in self._clients())

    def wait_for_services(self, timeout_sec: float | None = None) -> bool:
        """Wait for all six services, at most `timeout_sec` seconds; returns whether they exist.

        Raises RCLError when a signal has shut the context down, InvalidHandle when the program has.
        """
        end = None if timeout_sec is None else time.monotonic() + timeout_sec
        while not self.services_are_ready():
            left = _POLL_INTERVAL if end is None else end - time.monotonic()
            if left <= 0:
                return False
            time.sleep(min(left, _POLL_INTERVAL))
        return True

    def list_parameters(
        self,
        prefixes: list[str] | None = None,
        depth: int | None = None,
        callback: Done | None = None,
    ) -> Future[Any]:
        """Request the names of parameters, below these prefixes and at most `depth` levels deep."""
        request = ListParameters.Request(prefixes=prefixes or [], depth=depth or 0)
        return _call(self._list_parameter_client, request, callback)

    def get_parameters(self, names: list[str], callback: Done | None = None) -> Future[Any]:
        """Request values; the response has no values if one of the names is not declared."""
        request = GetParameters.Request(names=names)
        return _call(self._get_parameter_client, request, callback)

    def set_parameters(
        self, parameters: Sequence[Any], callback: Done | None = None
    ) -> Future[Any]:
        """Set parameters one after the other; each is a `Parameter` or its message."""
        request = SetParameters.Request(parameters=_messages(parameters))
        return _call(self._set_parameter_client, request, callback)

    def describe_parameters(self, names: list[str], callback: Done | None = None) -> Future[Any]:
        """Request descriptors."""
        request = DescribeParameters.Request(names=names)
        return _call(self._describe_parameters_client, request, callback)

    def get_parameter_types(self, names: list[str], callback: Done | None = None) -> Future[Any]:
        """Request the numbers of the types."""
        request = GetParameterTypes.Request(names=names)
        return _call(self._get_parameter_types_client, request, callback)

    def set_parameters_atomically(
        self, parameters: Sequence[Any], callback: Done | None = None
    ) -> Future[Any]:
        """Set all parameters or none; each is a `Parameter` or its message."""
        request = SetParametersAtomically.Request(parameters=_messages(parameters))
        return _call(self._set_parameters_atomically_client, request, callback)

    def delete_parameters(self, names: list[str], callback: Done | None = None) -> Future[Any]:
        """Undeclare parameters; those without dynamic typing stay."""
        return self.set_parameters([Parameter(name) for name in names], callback)

    def load_parameter_file(
        self, parameter_file: str, use_wildcard: bool = False, callback: Done | None = None
    ) -> Future[Any]:
        """Set the parameters of a YAML file, one after the other.

        Raises RuntimeError for a file that is not a parameter file.
        """
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters(list(found.values()), callback)

    def load_parameter_file_atomically(
        self, parameter_file: str, use_wildcard: bool = False, callback: Done | None = None
    ) -> Future[Any]:
        """Set all parameters of a YAML file, or none.

        Raises RuntimeError for a file that is not a parameter file.
        """
        found = parameter_dict_from_yaml_file(parameter_file, use_wildcard)
        return self.set_parameters_atomically(list(found.values()), callback)

    def on_parameter_event(
        self,
        callback: Callable[..., Any],
        qos_profile: QoSProfile = qos_profile_parameter_events,
        *,
        callback_group: CallbackGroup | None = None,
        event_callbacks: Any = None,
        qos_overriding_options: Any = None,
        raw: bool = False,
    ) -> Subscription[Any]:
        """Call `callback(event)` when parameters of any node change."""
        from ._impl.parameters.node_parameters import PARAMETER_EVENTS, ParameterEvent

        return self.node.create_subscription(
            ParameterEvent,
            PARAMETER_EVENTS,
            callback,
            qos_profile,
            callback_group=callback_group,
            event_callbacks=event_callbacks,
            qos_overriding_options=qos_overriding_options,
            raw=raw,
        )

    def _clients(self) -> list[Client[Any, Any]]:
        return [
            self._list_parameter_client,
            self._set_parameter_client,
            self._get_parameter_client,
            self._get_parameter_types_client,
            self._describe_parameters_client,
            self._set_parameters_atomically_client,
        ]


def _call(client: Client[Any, Any], request: Any, callback: Done | None) -> Future[Any]:
    future = client.call_async(request)
    if callback is not None:
        future.add_done_callback(callback)
    return future


def _messages(parameters: Sequence[Any]) -> list[Any]:
    return [one.to_parameter_msg() if isinstance(one, Parameter) else one for one in parameters]
