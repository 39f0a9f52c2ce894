"""Lab 2's checks of a definition, and of a server in memory."""

import asyncio

import pytest

import srvgen
from taskrpc import Node
from taskrpc.course.labs.checks.lab2 import LAB
from taskrpc.course.labs.lab import NeedsCheck, NotMet
from tests.labs.memory_trial import check_of, memory_trial

RIGHT = """\
string task_type
string<=20 target
int32 priority 5
int32 MAX_PRIORITY=10
---
bool success
string message
int32 task_id
float32 estimated_time
"""
VALID, FIELDS = "the definition is valid", "the definition has the fields of the steps"
OFFERS = "the server offers the service"
ACCEPTS = "the server accepts valid tasks"
REFUSES = "the server refuses invalid tasks, and says why"
SECONDS = {"move": 5.0, "scan": 3.0, "report": 1.0}


def write_definition(folder, text):
    path = folder / "robot_interfaces" / "srv" / "RobotTask.srv"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)


async def check_definition(title, folder, text):
    write_definition(folder, text)
    async with memory_trial(folder, {}) as trial:
        await check_of(LAB, title)(trial)


@pytest.mark.parametrize(
    "text",
    [
        RIGHT,
        "# a comment\n\n" + RIGHT.replace("int32 priority 5", "int32   priority   5  # urgent"),
        RIGHT.replace("---", "int32 MIN_PRIORITY=1\n---"),
        "int32 MAX_PRIORITY = 10\n" + RIGHT.replace("int32 MAX_PRIORITY=10\n", ""),
    ],
)
async def test_right_definition_passes_in_any_style(text, tmp_path):
    await check_definition(FIELDS, tmp_path, text)


@pytest.mark.parametrize(
    ("line", "instead", "words"),
    [
        ("int32 priority 5", "int priority 5", "line 3, column 1: .* got 'int'; `srvgen check"),
        ("---\n", "", "line 8, column .*expected one line ---"),
        (RIGHT, "---\n", "a definition with fields; it has none"),
        ("float32 e", "float32 E", "line 9, column 9: expected the name of a field"),
    ],
)
async def test_mistake_in_a_definition_is_shown_with_its_place(line, instead, words, tmp_path):
    with pytest.raises(NotMet, match=words):
        await check_definition(VALID, tmp_path, RIGHT.replace(line, instead))


@pytest.mark.parametrize(
    ("line", "instead", "words"),
    [
        ("string<=20", "string", "target to be of type string with at most 20 ch.*`string target`"),
        ("string<=20", "string[<=20]", r"target to be of .*; line 2 is `string\[<=20\] target`"),
        (" 5\n", "\n", "priority to be of type int32, default 5; line 3 is `int32 priority`"),
        ("=10", "=11", "MAX_PRIORITY to be a constant of type int32 with the value 10"),
        ("int32 MAX_PRIORITY=10\n", "", "request to have a constant MAX_PRIORITY; it has no con"),
        ("float32 est", "float64 est", "estimated_time to be of type float32, without a default"),
        ("bool success\n", "", "the response to have a field success; it has message, task_id"),
        ("int32 task_id\n", "int32 task_id\nint8 more\n", "response to have no field more; line 9"),
        (
            "bool success\nstring message",
            "string message\nbool success",
            "in the order success, message, .*; they are message, success",
        ),
    ],
)
async def test_definition_with_other_fields_is_explained(line, instead, words, tmp_path):
    assert line in RIGHT
    with pytest.raises(NotMet, match=words):
        await check_definition(FIELDS, tmp_path, RIGHT.replace(line, instead))


async def test_missing_definition_is_named_with_those_that_exist(tmp_path):
    folder = tmp_path / "robot_interfaces" / "srv"
    folder.mkdir(parents=True)
    (folder / "robottask.srv").write_text(RIGHT)
    async with memory_trial(tmp_path, {}) as trial:
        with pytest.raises(NotMet, match=r"robot_interfaces/srv/RobotTask\.srv; .*robottask\.srv"):
            await check_of(LAB, VALID)(trial)


def server(callback, definition=RIGHT):
    """Return a server whose callback gets a request, a response and the next id."""

    async def run(program):
        robot_task = srvgen.define("robot_interfaces/srv/RobotTask", definition)
        accepted = []

        def handle(request, response):
            callback(request, response, len(accepted) + 1)
            if response.success:
                accepted.append(request)
            return response

        async with Node("server", transport="memory") as node:
            node.create_service(robot_task, "robot_task", handle)
            await asyncio.Event().wait()

    return run


def refuse(response, message, task_id=-1):
    response.success, response.message, response.task_id = False, message, task_id


def accept(request, response, task_id):
    response.success, response.message, response.task_id = True, "queued", task_id
    response.estimated_time = SECONDS.get(request.task_type, 1.0)


def right(request, response, next_id):
    if request.task_type not in SECONDS:
        refuse(response, f"invalid task: {request.task_type}")
    elif not 1 <= request.priority <= 10:
        refuse(response, f"invalid priority: {request.priority}")
    else:
        accept(request, response, next_id)


async def check_server(title, folder, callback, definition=RIGHT):
    write_definition(folder, definition)
    async with memory_trial(folder, {"server.py": server(callback, definition)}) as trial:
        await check_of(LAB, title)(trial)


@pytest.mark.parametrize("title", [OFFERS, ACCEPTS, REFUSES])
@pytest.mark.parametrize(
    ("line", "instead"),
    [
        ("int32 priority 5", "int64 priority 5"),
        ("int32 priority 5", "int8 priority 5"),
        ("int32 priority 5", "uint8 priority 5"),
        ("int32 priority 5", "int32 priority"),
        ("int32 MAX_PRIORITY=10\n", "int32 MAX_PRIORITY=11\n"),
        ("int32 task_id", "int16 task_id"),
        ("float32 est", "float64 est"),
        ("bool success\nstring message", "string message\nbool success"),
        ("bool success", "int32 extra\nbool success"),
    ],
)
async def test_a_wrong_type_in_the_definition_fails_no_check_of_the_server(
    title, line, instead, tmp_path
):
    assert line in RIGHT
    definition = RIGHT.replace(line, instead)
    await check_server(title, tmp_path, right, definition)
    with pytest.raises(NotMet):
        await check_definition(FIELDS, tmp_path, definition)


@pytest.mark.parametrize(
    ("title", "line", "instead"),
    [
        (ACCEPTS, "int32 priority 5", "int32 importance 5"),
        (ACCEPTS, "float32 est", "int32 est"),
        (ACCEPTS, "string task_type", "string[] task_type"),
        (ACCEPTS, "string task_type", "string<=3 task_type"),
        (REFUSES, "int32 task_id", "uint32 task_id"),
    ],
)
async def test_a_check_that_the_definition_prevents_is_not_run(title, line, instead, tmp_path):
    assert line in RIGHT
    with pytest.raises(NeedsCheck, match=FIELDS):
        await check_server(title, tmp_path, right, RIGHT.replace(line, instead))


@pytest.mark.parametrize("title", [ACCEPTS, REFUSES])
async def test_right_server_passes(title, tmp_path):
    await check_server(title, tmp_path, right)


@pytest.mark.parametrize(
    ("title", "callback", "words"),
    [
        (ACCEPTS, lambda req, res, n: refuse(res, "no"), "accepted; success is false, .*'no'"),
        (ACCEPTS, lambda req, res, n: accept(req, res, 0), "they are 0, 0, 0"),
        (REFUSES, accept, "refused; success is true, and message is 'queued'"),
        (REFUSES, lambda req, res, n: refuse(res, "invalid"), "a message that contains dance"),
        (
            REFUSES,
            lambda req, res, n: refuse(res, req.task_type, n),
            "for the refused task .*; tas",
        ),
    ],
)
async def test_wrong_server_is_explained(title, callback, words, tmp_path):
    with pytest.raises(NotMet, match=words):
        await check_server(title, tmp_path, callback)
