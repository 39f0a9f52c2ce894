"""Lab 2: a service type of one's own, and a server that refuses invalid requests."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import srvgen
from srvgen.definitions.literals import INTEGER_RANGES
from srvgen.definitions.model import Constant, Field, FieldType, MessageDef, ServiceDef
from taskrpc.client import Client
from taskrpc.course.labs.checks.common import answer, service_of
from taskrpc.course.labs.lab import Check, Lab, NeedsCheck, NotMet
from taskrpc.course.labs.starter import filled
from taskrpc.course.labs.trial import Trial
from taskrpc.course.labs.variants import Variant

_PACKAGES = (
    "robot_interfaces",
    "campus_interfaces",
    "depot_interfaces",
    "harbour_interfaces",
    "hospital_interfaces",
)
_TYPES = {
    "RobotTask": "robot_task",
    "RobotOrder": "robot_order",
    "RobotJob": "robot_job",
    "TaskRequest": "task_request",
}
_KINDS = ("task_type", "task_name", "job_type", "order_type")
_TARGETS = ("target", "place", "location", "destination")
_PRIORITIES = ("priority", "urgency", "importance", "rank")
_TASKS = ("move", "scan", "report")
_SECONDS = ("5.0", "3.0", "1.0")
_LONGEST = 10
"""Characters that a text of the checks has at most."""
_FIELDS = "the definition has the fields of the steps"

_DEFINITION = """\
string @KIND@
string<=@BOUND@ @TARGET@
int32 @PRIORITY@ @DEFAULT@
int32 MAX_@PRIORITY_CAPS@=@MAX@
---
bool success
string message
int32 task_id
float32 estimated_time
"""


def _values(variant: Variant) -> Mapping[str, str]:
    type_name = variant.choose("type", tuple(_TYPES))
    priority = variant.choose("priority", _PRIORITIES)
    seconds = variant.order("seconds", _SECONDS)
    return {
        "PACKAGE": variant.choose("package", _PACKAGES),
        "TYPE": type_name,
        "SERVICE": _TYPES[type_name],
        "KIND": variant.choose("kind", _KINDS),
        "TARGET": variant.choose("target", _TARGETS),
        "BOUND": str(variant.number("bound", 20, 40)),
        "PRIORITY": priority,
        "PRIORITY_CAPS": priority.upper(),
        "DEFAULT": str(variant.number("default", 5, 9)),
        "MAX": str(variant.number("max", 10, 30)),
        **{task.upper(): each for task, each in zip(_TASKS, seconds, strict=True)},
    }


def _path(variant: Variant) -> str:
    return filled("@PACKAGE@/srv/@TYPE@.srv", _values(variant))


def _parsed(text: str, variant: Variant) -> ServiceDef:
    values = _values(variant)
    return srvgen.parse_srv(text, values["PACKAGE"], values["TYPE"])


def _wanted(variant: Variant) -> ServiceDef:
    """Return the definition that the steps describe."""
    return _parsed(filled(_DEFINITION, _values(variant)), variant)


def _own_text(trial: Trial) -> str:
    """Return the file that the student wrote; raises NotMet if there is none."""
    path = _path(trial.variant)
    try:
        return (trial.folder / path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError):
        found = sorted(each.name for each in trial.folder.glob("*/srv/*"))
        raise NotMet(
            f"a file {path}",
            f"the folders srv have {' and '.join(found) or 'no file'}",
            "the name of the file is the name of the type, with its capitals",
        ) from None


def _own_definition(trial: Trial) -> ServiceDef:
    """Return the definition that the student wrote; raises NotMet if it is not valid."""
    path, text = _path(trial.variant), _own_text(trial)
    try:
        return _parsed(text, trial.variant)
    except srvgen.DefinitionError as error:
        raise NotMet(
            f"{path} to be a valid definition",
            f"line {error.line}, column {error.column}: {error.message}",
            f"`srvgen check {path}` shows the place and, if it can, a hint",
        ) from None


async def _is_valid(trial: Trial) -> None:
    own = _own_definition(trial)
    if not own.request.fields and not own.response.fields:
        raise NotMet(
            f"{_path(trial.variant)} to be a definition with fields",
            "it has none",
            "write a line `type name` below the comment of each step",
        )


async def _has_fields(trial: Trial) -> None:
    own = _own_definition(trial)
    expected = _wanted(trial.variant)
    parts = [("request", expected.request, own.request)]
    parts += [("response", expected.response, own.response)]
    for part, wanted, found in parts:
        for problem in _differences(part, wanted, found):
            raise problem


def _differences(part: str, wanted: MessageDef, found: MessageDef) -> Iterator[NotMet]:
    """Yield what is different in a request or response; the first difference is shown."""
    kinds: list[tuple[str, Sequence[Field | Constant], Sequence[Field | Constant]]] = [
        ("field", wanted.fields, found.fields),
        ("constant", wanted.constants, found.constants),
    ]
    for kind, wants, has in kinds:
        yield from _missing(part, kind, wants, has)
        names = [each.name for each in wants]
        # Constants are never sent: one more disturbs nobody.
        extras = [each for each in has if each.name not in names] if kind == "field" else []
        for extra in extras:
            yield NotMet(
                f"the {part} to have no {kind} {extra.name}",
                f"line {extra.line} is `{_line(extra)}`",
                "compare names and parts with the comments: does it belong below the dashes?"
                if part == "request"
                else "compare names and parts with the comments: does it belong above the dashes?",
            )
    order = [each.name for each in wanted.fields]
    if [each.name for each in found.fields] != order:
        yield NotMet(
            f"the fields of the {part} in the order {', '.join(order)}",
            f"they are {', '.join(each.name for each in found.fields)}",
            "the order is a part of the type: client and server must agree on it",
        )


def _missing(
    part: str, kind: str, wants: Sequence[Field | Constant], has: Sequence[Field | Constant]
) -> Iterator[NotMet]:
    """Yield the fields or constants that are not there, or not as they must be."""
    own = {each.name: each for each in has}
    for each in wants:
        if each.name not in own:
            yield NotMet(
                f"the {part} to have a {kind} {each.name}",
                f"it has {', '.join(own) or f'no {kind}'}",
                "each line is `type name`; a constant is `type NAME=value`"
                if kind == "constant"
                else "read the step for this field again, with its name and its place",
            )
        elif _line(own[each.name]) != _line(each):
            yield NotMet(
                f"{each.name} to be {_in_words(each)}",
                f"line {own[each.name].line} is `{_line(own[each.name])}`",
                "read its step; the sheet shows how bounds, defaults and constants are written",
            )


def _line(each: Field | Constant) -> str:
    """Return a line as it is written in a definition."""
    if isinstance(each, Constant):
        return f"{each.type} {each.name}={each.value}"
    default = "" if each.default is None else f" {each.default}"
    return f"{each.type} {each.name}{default}"


def _in_words(each: Field | Constant) -> str:
    """Return what a line must say, without the line."""
    if isinstance(each, Constant):
        return f"a constant of type {each.type} with the value {each.value}"
    words = f"of type {each.type.base}"
    if each.type.string_bound is not None:
        words += f" with at most {each.type.string_bound} characters"
    return words + (", without a default" if each.default is None else f", default {each.default}")


class TaskClient:
    """A client of the submission's service that knows the names of the variant.

    Its type is the definition of the student, so that a wrong type of a field fails in the check of
    the definition only. Raises NeedsCheck if the fields are too different to call the service, and
    NotMet if the program does not offer it.
    """

    def __init__(self, variant: Variant, client: Client[Any, Any], own: ServiceDef) -> None:
        self.values = _values(variant)
        self._client = client
        self._priorities = _range_of(own.request, self.values["PRIORITY"])
        self._ids = _range_of(own.response, "task_id")

    @classmethod
    async def of(cls, trial: Trial) -> TaskClient:
        """Start the submission's server and connect to it."""
        own = _own_definition(trial)
        _expect_usable(own, trial.variant)
        return cls(trial.variant, await _service_of(trial), own)

    async def submit(self, task: str, priority: int | None = None) -> tuple[str, Any]:
        """Call the service; returns the request in words, and the response."""
        kind, field = self.values["KIND"], self.values["PRIORITY"]
        fields: dict[str, Any] = {kind: task, self.values["TARGET"]: "station 3"}
        words = f"{kind}={task!r}"
        if priority is not None:
            fields[field] = priority
            words += f" {field}={priority}"
        return words, await answer(self._client, self._client.srv_type.Request(**fields), words)

    async def accepted(self, task: str, priority: int | None = None) -> Any:
        """Return the response to a valid task; raises NotMet if the server refuses it."""
        words, response = await self.submit(task, priority)
        if not response.success:
            raise NotMet(
                f"the task {words} to be accepted",
                f"success is false, and message is {response.message!r}",
                "which condition of the callback is true for these values?",
            )
        return response

    async def refused(self, wrong: str, task: str, priority: int | None = None) -> None:
        """Raise NotMet if the server accepts an invalid task, or does not name what is wrong."""
        if -1 not in self._ids:
            raise NeedsCheck(_FIELDS)
        if priority is not None and priority not in self._priorities:
            return  # no client can send it
        words, response = await self.submit(task, priority)
        if response.success:
            raise NotMet(
                f"the task {words} to be refused",
                f"success is true, and message is {response.message!r}",
                "check the values first, and return the response at once if one is not valid",
            )
        if wrong not in response.message:
            raise NotMet(
                f"a message that contains {wrong}, which is wrong in the task {words}",
                f"message is {response.message!r}",
                "the person who reads the message must find the mistake: name the wrong value",
            )
        if response.task_id != -1:
            raise NotMet(
                f"task_id=-1 for the refused task {words}",
                f"task_id={response.task_id}",
                "a refused task has no number; set every field before you return",
            )


def _expect_usable(own: ServiceDef, variant: Variant) -> None:
    """Raise NeedsCheck if the checks cannot fill in the request, or read the response."""
    wanted = _wanted(variant)
    for needs, has in ((wanted.request, own.request), (wanted.response, own.response)):
        types = {each.name: each.type for each in has.fields}
        for each in needs.fields:
            if each.name not in types or _kind(types[each.name]) != _kind(each.type):
                raise NeedsCheck(_FIELDS)


def _kind(field_type: FieldType) -> str:
    """Return what the values of a type are; "" for types that no field of the lab needs."""
    base, bound = field_type.base, field_type.string_bound
    if field_type.is_array or not field_type.is_primitive or base == "byte":
        return ""
    if base in INTEGER_RANGES:
        return "integer"
    if base in ("string", "wstring") and bound is not None and bound < _LONGEST:
        return ""
    return {"float32": "number", "float64": "number", "wstring": "string"}.get(base, base)


def _range_of(message: MessageDef, name: str) -> range:
    """Return the values that an integer field can have."""
    base = next(each.type.base for each in message.fields if each.name == name)
    low, high = INTEGER_RANGES[base]
    return range(low, high + 1)


async def _service_of(trial: Trial) -> Client[Any, Any]:
    """Start the server; returns a client with the student's own type."""
    values, own = _values(trial.variant), _own_text(trial)
    try:
        srv_type = srvgen.define(f"{values['PACKAGE']}/srv/{values['TYPE']}", own)
    except srvgen.DefinitionError:  # a field of a message type that does not exist
        raise NeedsCheck(_FIELDS) from None
    server = await trial.start("server.py")
    return await service_of(trial, server, srv_type, f"/{values['SERVICE']}")


async def _offers(trial: Trial) -> None:
    await _service_of(trial)


async def _accepts(trial: Trial) -> None:
    client = await TaskClient.of(trial)
    ids: list[int] = []
    for task in _TASKS:
        response = await client.accepted(task, trial.unpredictable(1, int(client.values["MAX"])))
        seconds = float(client.values[task.upper()])
        if response.estimated_time != seconds:
            raise NotMet(
                f"estimated_time={seconds:g} for the task {task!r}",
                f"estimated_time={response.estimated_time:g}",
                "SECONDS has the time of each task",
            )
        ids.append(response.task_id)
    if ids != [1, 2, 3]:
        raise NotMet(
            "task_id 1, 2 and 3 for the first three tasks",
            f"they are {', '.join(map(str, ids))}",
            "count self.task_counter up, then use it",
        )


async def _refuses(trial: Trial) -> None:
    client = await TaskClient.of(trial)
    number = trial.unpredictable(100, 999)
    await client.refused(f"dance{number}", f"dance{number}", 3)
    most = int(client.values["MAX"])
    for priority in (0, -number, most + 1, most + number):
        await client.refused(str(priority), "move", priority)
    response = await client.accepted("move", most)
    if response.task_id != 1:
        raise NotMet(
            "task_id=1 for the first valid task, after refused ones",
            f"task_id={response.task_id}: refused tasks used up ids",
            "when does the server count: before or after it has checked the values?",
        )


_VALID = "the definition is valid"
_OFFERS = "the server offers the service"

LAB = Lab(
    number=2,
    title="Your own service type",
    minutes=20,
    goal="You can define a service type, and write a server that refuses what is not valid.",
    files=(
        "@PACKAGE@/srv/@TYPE@.srv",
        "server.py",
        "@PACKAGE@/package.xml",
        "@PACKAGE@/CMakeLists.txt",
    ),
    values=_values,
    checks=(
        Check(_VALID, 1, _is_valid),
        Check(_FIELDS, 3, _has_fields, needs=(_VALID,)),
        Check(_OFFERS, 1, _offers, needs=(_VALID,)),
        Check("the server accepts valid tasks", 2, _accepts, needs=(_OFFERS,)),
        Check(
            "the server refuses invalid tasks, and says why",
            3,
            _refuses,
            needs=(_OFFERS,),
        ),
    ),
)
