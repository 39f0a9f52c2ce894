"""rosapi tells clients about the network, about types, parameters and the time."""

import asyncio
import json

import pytest

import srvgen
from taskrpc.bridges.rosbridge import rosapi
from tests.bridges.rosbridge.clients import connected

ADD = srvgen.load("example_interfaces/srv/AddTwoInts")
TEXT = srvgen.load("std_msgs/msg/String")
RCL = "rcl_interfaces/srv"


async def asked(client, verb, **args):
    response = await client.call(f"/rosapi/{verb}", args)
    assert response["result"] is True, response
    return response["values"]


def offer(node):
    node.create_publisher(TEXT, "/chatter")
    node.create_subscription(TEXT, "/listen", lambda message: None)
    node.create_service(ADD, "/add", lambda request, response: response)


async def test_topics_and_their_types():
    async with connected() as (node, client):
        offer(node)
        expected = {"topics": ["/chatter", "/listen"], "types": ["std_msgs/msg/String"] * 2}
        assert await asked(client, "topics") == expected
        raw = await asked(client, "topics_and_raw_types")
        assert "string data" in raw["typedefs_full_text"][0]
        for type_name in ("std_msgs/String", "std_msgs/msg/String"):
            found = await asked(client, "topics_for_type", type=type_name)
            assert found == {"topics": ["/chatter", "/listen"]}
        assert await asked(client, "topic_type", topic="chatter") == {"type": "std_msgs/msg/String"}
        assert await asked(client, "topic_type", topic="/unknown") == {"type": ""}
        assert await asked(client, "publishers", topic="/chatter") == {"publishers": ["/program"]}
        assert await asked(client, "subscribers", topic="/listen") == {"subscribers": ["/program"]}


async def test_services_nodes_and_actions():
    async with connected() as (node, client):
        offer(node)
        services = (await asked(client, "services"))["services"]
        assert "/add" in services
        assert "/rosapi/topics" in services
        type_name = "example_interfaces/srv/AddTwoInts"
        assert await asked(client, "service_type", service="add") == {"type": type_name}
        own = await asked(client, "service_type", service="/rosapi/topics")
        assert own == {"type": "rosapi_msgs/srv/Topics"}
        for name in (type_name, "example_interfaces/AddTwoInts"):
            assert await asked(client, "services_for_type", type=name) == {"services": ["/add"]}
        assert await asked(client, "service_node", service="/add") == {"node": "/program"}
        assert await asked(client, "service_node", service="/rosapi/topics") == {
            "node": "/rosbridge"
        }
        found = await asked(client, "service_providers", service="/nothing")
        assert found == {"providers": []}
        assert await asked(client, "nodes") == {"nodes": ["/program", "/rosbridge"]}
        assert await asked(client, "node_details", node="program") == {
            "subscribing": ["/listen"],
            "publishing": ["/chatter"],
            "services": ["/add"],
        }
        assert await asked(client, "action_servers") == {"action_servers": []}


async def test_action_is_recognised_by_its_services():
    async with connected() as (node, client):
        send_goal = srvgen.load("example_interfaces/action/Fibonacci").Impl.SendGoalService
        name = "/fibonacci/_action/send_goal"
        node.create_service(send_goal, name, lambda request, response: response)
        assert await asked(client, "action_servers") == {"action_servers": ["/fibonacci"]}
        assert name not in (await asked(client, "services"))["services"]


async def test_names_work_without_the_leading_slash():
    async with connected() as (_, client):
        response = await client.call("rosapi/nodes")
        assert response["service"] == "rosapi/nodes"
        assert response["result"] is True


async def test_message_type_is_described_with_the_types_inside():
    async with connected() as (_, client):
        for name in ("geometry_msgs/PoseStamped", "geometry_msgs/msg/PoseStamped"):
            found = (await asked(client, "message_details", type=name))["typedefs"]
            assert [each["type"] for each in found] == [
                "geometry_msgs/PoseStamped",
                "std_msgs/Header",
                "geometry_msgs/Pose",
                "builtin_interfaces/Time",
                "geometry_msgs/Point",
                "geometry_msgs/Quaternion",
            ]
        assert found[5]["examples"] == ["0.0", "0.0", "0.0", "1.0"]
        arrays = (await asked(client, "message_details", type="test_msgs/Arrays"))["typedefs"][0]
        assert (arrays["fieldtypes"][0], arrays["fieldarraylen"][0]) == ("bool", 3)
        battery = await asked(client, "message_details", type="sensor_msgs/BatteryState")
        assert "POWER_SUPPLY_STATUS_CHARGING" in battery["typedefs"][0]["constnames"]


async def test_service_type_is_described():
    async with connected() as (_, client):
        name = "my_robot_interfaces/RobotTask"
        request = (await asked(client, "service_request_details", type=name))["typedefs"][0]
        assert request["fieldnames"] == ["task_type", "target", "priority"]
        assert request["fieldtypes"] == ["string", "string", "int32"]
        response = (await asked(client, "service_response_details", type=name))["typedefs"][0]
        assert response["type"] == "my_robot_interfaces/RobotTask_Response"


async def test_service_type_that_only_its_server_knows_is_described():
    cls = srvgen.define("only_there/srv/Beep", "int32 times\n---\nbool done\n")
    async with connected() as (node, client):
        node.create_service(cls, "/beep", lambda request, response: response)
        found = await asked(client, "service_request_details", type="only_there/Beep")
        assert found["typedefs"][0]["fieldnames"] == ["times"]
        assert (await client.call("/beep", {"times": 2}))["values"] == {"done": False}


@pytest.mark.parametrize(
    ("verb", "type_name", "problem"),
    [
        ("message_details", "nothing/Here", "package 'nothing' not found"),
        ("message_details", "std_srvs/srv/Empty", "expected a message type"),
        ("service_request_details", "std_msgs/msg/String", "expected a service type"),
    ],
)
async def test_unknown_type_is_an_error(verb, type_name, problem):
    async with connected() as (_, client):
        response = await client.call(f"/rosapi/{verb}", {"type": type_name})
        assert response["result"] is False
        assert problem in response["values"]


async def test_interfaces_are_listed():
    async with connected() as (_, client):
        assert "std_msgs/msg/String" in (await asked(client, "interfaces"))["interfaces"]


async def test_files_of_interfaces_are_searched_once_a_second(monkeypatch):
    searches = []
    found = rosapi.search()
    monkeypatch.setattr(rosapi, "search", lambda: searches.append(1) or found)
    async with connected(2) as (_, client, other):
        for each in (client, other, client):
            assert (await asked(each, "interfaces"))["interfaces"]
        assert len(searches) == 1
        await asyncio.sleep(1)
        await asked(client, "interfaces")
        assert len(searches) == 2


async def test_time_has_both_spellings():
    async with connected() as (_, client):
        time = (await asked(client, "get_time"))["time"]
        assert time["sec"] == time["secs"] > 1_700_000_000
        assert time["nanosec"] == time["nsecs"] < 10**9


async def test_version_is_that_of_ros_2(monkeypatch):
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    async with connected() as (_, client):
        assert await asked(client, "get_ros_version") == {"version": 2, "distro": "jazzy"}


# Parameters


def offer_parameters(node, values):
    """The parameter services that every ROS node has."""
    services = {name: srvgen.load(f"{RCL}/{name}") for name in ("GetParameters", "SetParameters")}
    listing = srvgen.load(f"{RCL}/ListParameters")
    value_class = srvgen.load("rcl_interfaces/msg/ParameterValue")

    def get(request, response):
        response.values = [values.get(name, value_class()) for name in request.names]
        return response

    def set_(request, response):
        result = srvgen.load("rcl_interfaces/msg/SetParametersResult")
        for each in request.parameters:
            values[each.name] = each.value
            response.results.append(result(successful=True))
        return response

    def list_(request, response):
        response.result.names = sorted(values)
        return response

    node.create_service(services["GetParameters"], "/turtle/get_parameters", get)
    node.create_service(services["SetParameters"], "/turtle/set_parameters", set_)
    node.create_service(listing, "/turtle/list_parameters", list_)


@pytest.mark.parametrize("value", [True, 255, 0.5, "red", [1, 2], [0.5], ["a"], [True]])
async def test_parameter_is_set_and_read_as_json(value):
    async with connected() as (node, client):
        offer_parameters(node, {})
        name = "/turtle:x"
        missing = await asked(client, "get_param", name=name, default_value="7")
        assert (missing["value"], missing["successful"]) == ("7", False)
        assert await asked(client, "has_param", name=name) == {"exists": False}
        done = await asked(client, "set_param", name=name, value=json.dumps(value))
        assert done == {"successful": True, "reason": ""}
        found = await asked(client, "get_param", name=name)
        assert found == {"value": json.dumps(value), "successful": True, "reason": ""}
        assert await asked(client, "has_param", name=name) == {"exists": True}
        assert await asked(client, "get_param_names") == {"names": ["/turtle:x"]}
        await asked(client, "delete_param", name=name)
        assert await asked(client, "has_param", name=name) == {"exists": False}


async def test_number_gets_the_type_that_the_parameter_has():
    values = {}
    async with connected() as (node, client):
        offer_parameters(node, values)
        await asked(client, "set_param", name="turtle:speed", value="0.5")
        await asked(client, "set_param", name="turtle:speed", value="2")
        assert (values["speed"].type, values["speed"].double_value) == (3, 2.0)
        await asked(client, "set_param", name="turtle:name", value="red robot")
        await asked(client, "set_param", name="turtle:name", value="12")
        assert (values["name"].type, values["name"].string_value) == (4, "12")


@pytest.mark.parametrize(
    ("name", "value", "problem"),
    [
        ("speed", "1", "expected NODE:PARAMETER such as /turtlesim:background_r, got 'speed'"),
        ("/nobody:x", "1", "no server offers /nobody/get_parameters"),
        ("/turtle:x", '{"a": 1}', "expected a boolean, a number, a string, or a list"),
        ("/turtle:x", '[1, "a"]', "expected a boolean, a number, a string, or a list"),
        ("/turtle:x", str(2**64), "integer_value: expected int64"),
    ],
)
async def test_parameter_that_cannot_be_set_has_a_reason(name, value, problem):
    async with connected() as (node, client):
        offer_parameters(node, {})
        response = await asked(client, "set_param", name=name, value=value)
        assert response["successful"] is False
        assert problem in response["reason"]


async def test_node_that_does_not_answer_delays_the_list_of_parameters_by_two_seconds_only():
    async def never(request, response):
        await asyncio.Event().wait()

    async with connected() as (node, client):
        offer_parameters(node, {"x": srvgen.load("rcl_interfaces/msg/ParameterValue")(type=1)})
        listing = srvgen.load(f"{RCL}/ListParameters")
        node.create_service(listing, "/asleep/list_parameters", never)
        began = asyncio.get_running_loop().time()
        assert await asked(client, "get_param_names") == {"names": ["/turtle:x"]}
        assert asyncio.get_running_loop().time() - began < 2.5
