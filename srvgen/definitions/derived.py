"""Derived types: the events of a service, and the services and messages of an action."""

from __future__ import annotations

from .model import ActionDef, Definition, Field, FieldType, MessageDef, ServiceDef

_UUID = FieldType("UUID", "unique_identifier_msgs")
_TIME = FieldType("Time", "builtin_interfaces")
_SHARED_BY_ACTIONS = (
    Field("cancel_goal_service", FieldType("CancelGoal", "action_msgs", kind="srv")),
    Field("goal_status_message", FieldType("GoalStatusArray", "action_msgs")),
)
"""Types that all actions share and refer to in `Impl`, written as fields."""
_EVENT_INFO = FieldType("ServiceEventInfo", "service_msgs")


def event(service: ServiceDef) -> MessageDef:
    """`X_Event`: the message that service introspection publishes for a call."""
    request, response = service.request, service.response
    return MessageDef(
        request.package,
        request.kind,
        f"{service.name}_Event",
        (
            Field("info", _EVENT_INFO),
            Field("request", _at_most_one(request)),
            Field("response", _at_most_one(response)),
        ),
    )


def send_goal(action: ActionDef) -> ServiceDef:
    """`X_SendGoal`: the service that sends a goal."""
    return _service(
        action,
        "SendGoal",
        (Field("goal_id", _UUID), Field("goal", _nested(action.goal))),
        (Field("accepted", FieldType("bool")), Field("stamp", _TIME)),
    )


def get_result(action: ActionDef) -> ServiceDef:
    """`X_GetResult`: the service that waits for a result."""
    return _service(
        action,
        "GetResult",
        (Field("goal_id", _UUID),),
        (Field("status", FieldType("int8")), Field("result", _nested(action.result))),
    )


def feedback_message(action: ActionDef) -> MessageDef:
    """`X_FeedbackMessage`: the message that is published while a goal is executed."""
    fields = (Field("goal_id", _UUID), Field("feedback", _nested(action.feedback)))
    return MessageDef(action.package, "action", f"{action.name}_FeedbackMessage", fields)


def derived_types(definition: Definition) -> list[Definition]:
    """Every type that a definition implies: its sections, events, and the services of an action."""
    match definition:
        case ServiceDef():
            return [definition.request, definition.response, event(definition)]
        case ActionDef():
            services = (send_goal(definition), get_result(definition))
            return [
                definition.goal,
                definition.result,
                definition.feedback,
                *(one for service in services for one in (service, *derived_types(service))),
                feedback_message(definition),
            ]
        case _:
            return []


def as_message(definition: Definition) -> MessageDef:
    """A definition as one message whose fields are its parts, as type descriptions have it."""
    match definition:
        case ServiceDef():
            parts = {
                "request_message": definition.request,
                "response_message": definition.response,
                "event_message": event(definition),
            }
            package, kind = definition.package, definition.request.kind
        case ActionDef():
            parts = {
                "goal": definition.goal,
                "result": definition.result,
                "feedback": definition.feedback,
                "send_goal_service": as_message(send_goal(definition)),
                "get_result_service": as_message(get_result(definition)),
                "feedback_message": feedback_message(definition),
            }
            package, kind = definition.package, "action"
        case _:
            return definition
    fields = tuple(Field(name, _nested(part)) for name, part in parts.items())
    return MessageDef(package, kind, definition.name, fields)


def references(definition: Definition) -> list[Field]:
    """The fields of a definition and its derived types that refer to other files.

    The fields of the text come first, with their line numbers; the types that all actions share
    come last.
    """
    shared = _SHARED_BY_ACTIONS if isinstance(definition, ActionDef) else ()
    own = [
        field
        for message in (definition, *derived_types(definition))
        if isinstance(message, MessageDef)
        for field in message.fields
        # Only derived types refer to their own .srv or .action file.
        if field.type.package and field.type.kind == "msg"
    ]
    return [*own, *shared]


def _service(
    action: ActionDef, name: str, request: tuple[Field, ...], response: tuple[Field, ...]
) -> ServiceDef:
    full = f"{action.name}_{name}"
    return ServiceDef(
        action.package,
        full,
        MessageDef(action.package, "action", f"{full}_Request", request),
        MessageDef(action.package, "action", f"{full}_Response", response),
    )


def _nested(message: MessageDef) -> FieldType:
    return FieldType(message.name, message.package, kind=message.kind)


def _at_most_one(message: MessageDef) -> FieldType:
    return FieldType(
        message.name,
        message.package,
        is_array=True,
        array_size=1,
        is_upper_bound=True,
        kind=message.kind,
    )
