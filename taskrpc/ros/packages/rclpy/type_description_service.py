"""The service `~/get_type_description` of every node, which describes types."""

from __future__ import annotations

import weakref
from typing import TYPE_CHECKING, Any, Final

import srvgen
from srvgen.classes.loader import search
from srvgen.typehash import type_description

from ._impl.node_interface import NodeInterface
from .qos import qos_profile_services_default

if TYPE_CHECKING:
    from srvgen.stubs.type_description_interfaces.srv import GetTypeDescription

START_TYPE_DESCRIPTION_SERVICE_PARAM = "start_type_description_service"
"""The parameter that disables the service when it is false at the start."""

_TYPE: Final = "type_description_interfaces/srv/GetTypeDescription"


class TypeDescriptionService:
    """Offers the service; every node creates its own."""

    def __init__(self, node: NodeInterface) -> None:
        self._node = weakref.ref(node)
        descriptor = srvgen.load("rcl_interfaces/msg/ParameterDescriptor")(
            description="Start the ~/get_type_description service for this node.", read_only=True
        )
        wanted = node.declare_parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM, True, descriptor)
        if not isinstance(wanted.value, bool):
            raise TypeError(
                f"{START_TYPE_DESCRIPTION_SERVICE_PARAM}: expected a bool, got {wanted.value!r}"
            )
        self.enabled = wanted.value
        if self.enabled:
            node.create_service(
                srvgen.load(_TYPE),
                "~/get_type_description",
                self._answer,
                qos_profile=qos_profile_services_default,
            )

    def _answer(
        self, request: GetTypeDescription.Request, response: GetTypeDescription.Response
    ) -> GetTypeDescription.Response:
        try:
            known = srvgen.load(request.type_name)
        except (srvgen.DefinitionError, ValueError) as error:
            response.failure_reason = str(error)
            return response
        if request.type_hash not in ("", known._HASH):
            response.failure_reason = (
                f"{request.type_name} has the hash {known._HASH} here, not {request.type_hash}"
            )
            return response
        response.successful = True
        response.type_description = described(request.type_name)
        if request.include_type_sources:
            response.type_sources = sources(known)
        return response


def described(type_name: str) -> Any:
    """The TypeDescription of a type and the types that it uses."""
    plain = type_description(search().load(type_name), search().load)
    return srvgen.load("type_description_interfaces/msg/TypeDescription")(
        type_description=_individual(plain["type_description"]),
        referenced_type_descriptions=[
            _individual(one) for one in plain["referenced_type_descriptions"]
        ],
    )


def sources(known: Any) -> list[Any]:
    """The definitions of a type and the types that it uses, as texts."""
    source = srvgen.load("type_description_interfaces/msg/TypeSource")
    names = [one.full_name for one in reversed(search().with_dependencies(known._TYPE))]
    return [
        source(type_name=name, encoding=name.split("/")[1], raw_file_contents=search().text(name))
        for name in names
    ]


def _individual(plain: dict[str, Any]) -> Any:
    described = srvgen.load("type_description_interfaces/msg/IndividualTypeDescription")
    field, kind = (
        srvgen.load(f"type_description_interfaces/msg/{name}") for name in ("Field", "FieldType")
    )
    fields = [field(name=one["name"], type=kind(**one["type"])) for one in plain["fields"]]
    return described(type_name=plain["type_name"], fields=fields)
