"""The six services with which other programs get and set the parameters of a node."""

from __future__ import annotations

import weakref
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import srvgen

from ._impl.node_interface import NodeInterface
from .exceptions import ParameterNotDeclaredException, ParameterUninitializedException
from .parameter import Parameter
from .qos import qos_profile_parameters

if TYPE_CHECKING:
    from srvgen.stubs.rcl_interfaces import srv

ListParametersResult = srvgen.load("rcl_interfaces/msg/ListParametersResult")
SetParametersResult = srvgen.load("rcl_interfaces/msg/SetParametersResult")
DescribeParameters = srvgen.load("rcl_interfaces/srv/DescribeParameters")
GetParameters = srvgen.load("rcl_interfaces/srv/GetParameters")
GetParameterTypes = srvgen.load("rcl_interfaces/srv/GetParameterTypes")
ListParameters = srvgen.load("rcl_interfaces/srv/ListParameters")
SetParameters = srvgen.load("rcl_interfaces/srv/SetParameters")
SetParametersAtomically = srvgen.load("rcl_interfaces/srv/SetParametersAtomically")


class ParameterService:
    """Offers the parameter services of one node, such as `/node/get_parameters`.

    As in ROS, the response about an undeclared parameter is empty.
    """

    def __init__(self, node: NodeInterface) -> None:
        self._node_weak_ref = weakref.ref(node)
        offered: list[tuple[Any, str, Callable[[Any, Any], Any]]] = [
            (DescribeParameters, "describe_parameters", self._describe_parameters_callback),
            (GetParameters, "get_parameters", self._get_parameters_callback),
            (GetParameterTypes, "get_parameter_types", self._get_parameter_types_callback),
            (ListParameters, "list_parameters", self._list_parameters_callback),
            (SetParameters, "set_parameters", self._set_parameters_callback),
            (
                SetParametersAtomically,
                "set_parameters_atomically",
                self._set_parameters_atomically_callback,
            ),
        ]
        for srv_type, name, callback in offered:
            node.create_service(
                srv_type,
                f"{node.get_name()}/{name}",
                callback,
                qos_profile=qos_profile_parameters,
            )

    def _describe_parameters_callback(
        self, request: srv.DescribeParameters.Request, response: srv.DescribeParameters.Response
    ) -> srv.DescribeParameters.Response:
        try:
            response.descriptors = self._get_node().describe_parameters(request.names)
        except ParameterNotDeclaredException:
            response.descriptors = []
        return response

    def _get_parameters_callback(
        self, request: srv.GetParameters.Request, response: srv.GetParameters.Response
    ) -> srv.GetParameters.Response:
        try:
            found = self._get_node().get_parameters(request.names)
        except (ParameterNotDeclaredException, ParameterUninitializedException):
            found = []
        response.values = [parameter.get_parameter_value() for parameter in found]
        return response

    def _get_parameter_types_callback(
        self, request: srv.GetParameterTypes.Request, response: srv.GetParameterTypes.Response
    ) -> srv.GetParameterTypes.Response:
        try:
            found = self._get_node().get_parameter_types(request.names)
        except ParameterNotDeclaredException:
            found = []
        response.types = [Parameter.Type(kind).value for kind in found]
        return response

    def _list_parameters_callback(
        self, request: srv.ListParameters.Request, response: srv.ListParameters.Response
    ) -> srv.ListParameters.Response:
        try:
            response.result = self._get_node().list_parameters(
                list(request.prefixes), request.depth
            )
        except (TypeError, ValueError):
            response.result = ListParametersResult()
        return response

    def _set_parameters_callback(
        self, request: srv.SetParameters.Request, response: srv.SetParameters.Response
    ) -> srv.SetParameters.Response:
        response.results = [self._set([parameter]) for parameter in request.parameters]
        return response

    def _set_parameters_atomically_callback(
        self,
        request: srv.SetParametersAtomically.Request,
        response: srv.SetParametersAtomically.Response,
    ) -> srv.SetParametersAtomically.Response:
        response.result = self._set(request.parameters)
        return response

    def _set(self, parameters: Any) -> Any:
        """Set all or none. An invalid request must not end the spin of this program."""
        try:
            wanted = [Parameter.from_parameter_msg(one) for one in parameters]
            return self._get_node().set_parameters_atomically(wanted)
        except (ParameterNotDeclaredException, ValueError) as error:
            return SetParametersResult(successful=False, reason=str(error))

    def _get_node(self) -> NodeInterface:
        node = self._node_weak_ref()
        if node is None:
            raise ReferenceError("Expected valid node weak reference")
        return node
