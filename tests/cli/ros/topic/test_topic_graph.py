"""`taskrpc topic` lists topics, their types and their endpoints as ros2 does."""

from __future__ import annotations

import json
import re

from tests.cli.ros.topic.conftest import real_time


@real_time
def test_list_prints_the_topics(talker, run):
    assert run("list") == (0, "/chatter\n/heard\n/pose\n/state\n", "")
    assert run("list", "-c") == (0, "4\n", "")
    assert run("list", "-a")[1].startswith("/_hidden\n/chatter\n")
    assert run("--include-hidden-topics", "list", "-c")[1] == "5\n"
    assert "/pose [geometry_msgs/msg/PoseStamped]\n" in run("list", "-t")[1]
    assert json.loads(run("list", "--json")[1])[0] == {
        "name": "/chatter",
        "types": ["std_msgs/msg/String"],
    }
    assert run("list", "-v")[1] == (
        "Published topics:\n"
        " * /chatter [std_msgs/msg/String] 1 publisher\n"
        " * /pose [geometry_msgs/msg/PoseStamped] 1 publisher\n"
        " * /state [std_msgs/msg/String] 1 publisher\n"
        "\n"
        "Subscribed topics:\n"
        " * /heard [std_msgs/msg/String] 1 subscriber\n"
        "\n"
    )


@real_time
def test_type_and_find_print_what_ros2_prints(talker, run):
    assert run("type", "chatter") == (0, "std_msgs/msg/String\n", "")
    assert run("find", "std_msgs/String") == (0, "/chatter\n/heard\n/state\n", "")
    assert run("find", "std_msgs/msg/String", "-c") == (0, "3\n", "")
    code, out, err = run("type", "/chater")
    assert (code, out) == (1, "")
    assert err == "Unknown topic '/chater'\n  hint: did you mean /chatter?\n"


@real_time
def test_info_prints_type_and_endpoints(talker, run):
    assert run("info", "/chatter") == (
        0,
        "Type: std_msgs/msg/String\nPublisher count: 1\nSubscription count: 0\n",
        "",
    )
    told = run("info", "/pose", "-v")[1]
    assert told.startswith(
        "Type: geometry_msgs/msg/PoseStamped\n\nPublisher count: 1\n\nNode name: talker\n"
        "Node namespace: /lab\nTopic type: geometry_msgs/msg/PoseStamped\n"
    )
    assert "QoS profile:\n  Reliability: BEST_EFFORT\n  History (Depth): KEEP_LAST (5)\n" in told
    assert "  Durability: VOLATILE\n" in told
    assert told.endswith("\nSubscription count: 0\n\n")
    gids = re.findall(r"^Endpoint type: PUBLISHER\nGID: ((?:[0-9a-f]{2}\.){15}..)$", told, re.M)
    assert len(gids) == 1
    found = json.loads(run("info", "/pose", "--json")[1])
    assert [each["gid"] for each in found["publishers"]] == gids
    found = json.loads(run("info", "/state", "--json")[1])
    assert found["publishers"][0]["durability"] == "transient_local"
