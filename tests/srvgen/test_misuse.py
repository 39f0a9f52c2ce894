"""Errors of Python and msgspec that name the mistake in the use of a message or of taskrpc."""

import asyncio
import types

import msgspec
import pytest

import srvgen
import taskrpc
import taskrpc.sync
from srvgen import excepthook, misuse

AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
Pose = srvgen.load("geometry_msgs/msg/PoseStamped")
Log = srvgen.load("rcl_interfaces/msg/Log")


def explained(use, *arguments):
    """Return the text of the error that a use raises, after it was explained."""
    try:
        result = use(*arguments)
        if asyncio.iscoroutine(result):
            asyncio.run(result)
    except (AttributeError, TypeError) as error:
        excepthook.explain(error)
        excepthook.explain(error)  # a second time changes nothing
        return str(error)
    raise AssertionError("the use raised nothing")


def misspelt_keyword():
    AddTwoInts.Request(a=1, bb=2)


def no_fields_at_all():
    Empty = srvgen.load("std_srvs/srv/Empty")
    Empty.Request(data=1)


def without_names():
    AddTwoInts.Request(
        1,
        2,
    )


def assigned():
    request = AddTwoInts.Request()
    request.summ = 1


def read():
    return AddTwoInts.Response().summ


def nested():
    pose = Pose()
    pose.pose.positon = 3


def of_a_class_with_constants():
    Log(nam="x")


USES = {
    misspelt_keyword: "unknown field 'bb'; AddTwoInts_Request has a, b",
    no_fields_at_all: "unknown field 'data'; Empty_Request has no fields",
    without_names: "AddTwoInts_Request takes its fields by name: write"
    " AddTwoInts.Request(a=..., b=...)",
    assigned: "unknown field 'summ'; AddTwoInts_Request has a, b",
    read: "unknown field 'summ'; AddTwoInts_Response has sum; did you mean 'sum'?",
    nested: "unknown field 'positon'; Pose has position, orientation; did you mean 'position'?",
    of_a_class_with_constants: "unknown field 'nam'; Log has stamp, level, name, msg, file,"
    " function, line; did you mean 'name'?",
}


@pytest.mark.parametrize("use", USES, ids=lambda use: use.__name__)
def test_a_wrong_field_is_named_with_the_fields_of_the_class(use):
    assert explained(use) == USES[use]


def test_the_class_is_found_behind_letters_of_several_bytes():
    def use():
        return "äöü€", AddTwoInts.Request(c=1)

    assert explained(use) == "unknown field 'c'; AddTwoInts_Request has a, b"


def test_the_class_is_found_through_attributes():
    holder = types.SimpleNamespace(types=[AddTwoInts], add=AddTwoInts)
    assert "AddTwoInts_Request has" in explained(lambda: holder.add.Request(c=1))
    assert "'c'" in explained(lambda: holder.types[0].Request(c=1))  # msgspec's own words


def test_without_the_source_the_error_stays():
    program = compile("AddTwoInts.Request(c=1)", "<nowhere>", "exec")
    text = explained(lambda: exec(program, dict(globals())))
    assert text == "Unexpected keyword argument 'c'"


def test_another_struct_of_the_program_keeps_its_errors():
    class Own(msgspec.Struct):
        a: int = 0

    assert explained(lambda: Own(b=1)) == "Unexpected keyword argument 'b'"
    assert explained(lambda: Own(1, 2)) == "Extra positional arguments provided"


async def an_argument_of_rclpy():
    async with taskrpc.Node("a", transport="memory") as node:
        client = node.create_client(AddTwoInts, "add")
        await client.wait_for_service(timeout_sec=1)


async def a_callback_group():
    async with taskrpc.Node("a", transport="memory") as node:
        node.create_service(AddTwoInts, "add", lambda request, response: response, callback_group=1)


async def a_misspelt_argument():
    async with taskrpc.Node("a", transport="memory") as node:
        node.create_client(AddTwoInts, "add", timout=1)


def an_argument_of_a_class():
    taskrpc.Node(node_name="a")


async def an_await_too_much():
    node = taskrpc.sync.Node("a", transport="memory")
    await node.get_name()
    await node.create_client(AddTwoInts, "add")


async def an_await_too_few():
    async with taskrpc.Node("a", transport="memory") as node:
        response = node.create_client(AddTwoInts, "add").call(AddTwoInts.Request())
        try:
            return response.sum
        finally:
            response.close()


ARGUMENTS = {
    an_argument_of_rclpy: "Client.wait_for_service() has no argument 'timeout_sec';"
    " write timeout=, which is rclpy's timeout_sec",
    a_callback_group: "Node.create_service() has no argument 'callback_group'; there are no"
    " callback groups here: concurrency= is the number of calls at a time",
    a_misspelt_argument: "Node.create_client() has no argument 'timout'; did you mean timeout?",
    an_argument_of_a_class: "Node() has no argument 'node_name'; write name=, which is rclpy's"
    " node_name",
    an_await_too_much: "get_name() of taskrpc.sync returns its result itself: write it without"
    " `await`, or use taskrpc.Node in async code",
}


@pytest.mark.parametrize("use", ARGUMENTS, ids=lambda use: use.__name__)
def test_a_wrong_argument_is_explained(use):
    assert explained(use) == ARGUMENTS[use]


def test_a_forgotten_await_is_explained():
    assert explained(an_await_too_few) == (
        "Client.call() has not run, because nothing awaits it: write `await` before the call"
    )


def test_other_errors_keep_their_text():
    class Own:
        def method(self):
            pass

    uses = [
        lambda: Own().missing,
        lambda: Own().method(timeout_sec=1),
        lambda: taskrpc.creat_node,
        lambda: 1 + "1",
        lambda: print(timeout_sec=1),
    ]
    for use in uses:
        with pytest.raises((AttributeError, TypeError)) as caught:
            use()
        text = str(caught.value)
        assert not excepthook.explain(caught.value)
        assert str(caught.value) == text


def test_an_error_without_a_traceback_is_not_explained():
    assert misuse.explanation(TypeError("Unexpected keyword argument 'x'")) == ""
    assert misuse.explanation(AttributeError("'X' object has no attribute 'y'")) == ""


def test_a_property_that_fails_hides_nothing():
    class Holder:
        @property
        def add(self):
            raise RuntimeError("not ready")

    holder = Holder()
    with pytest.raises(RuntimeError, match="not ready"):
        holder.add.Request(c=1)
