"""Errors about a missing service list the available ones, and say why it is missing."""

from __future__ import annotations

import asyncio

import pytest

from taskrpc.cli.shared import graph
from taskrpc.cli.shared.remote import Remote
from taskrpc.core.transport import suggestions
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.wire.messages import ServiceEndpoint, TopicEndpoint


def entry(*names: str, type_name: str = "a/srv/A", pid: int = 1) -> RegistryEntry:
    services = tuple(ServiceEndpoint(name, type_name, "", "/n") for name in names)
    return RegistryEntry(pid, "s.py", "/", 0.0, "127.0.0.1:1", services=services)


@pytest.mark.parametrize(
    ("asked", "offered", "hint"),
    [
        ("/robot_tsk", ["/robot_task", "/x"], "did you mean /robot_task?"),
        ("/Robot_Task", ["/robot_task"], "did you mean /robot_task?"),
        ("/robot_task", ["/robot1/robot_task"], "did you mean /robot1/robot_task?"),
        ("/go", ["/add", "/mul", "/_hidden"], "there are /add, /mul"),
        ("/go", list("/a /b /c /d /e /f".split()), "there are /a, /b, /c, /d, /e, …"),
        ("/go", ["/add", "/n/get_parameters", "/n/list_parameters"], "there is /add"),
        ("/go", ["/n/get_parameters"], "there is /n/get_parameters"),
        ("/go", ["/_hidden"], "no taskrpc program offers a service on this machine in domain 0"),
    ],
)
def test_hint_names_the_most_similar_services(asked, offered, hint):
    told = graph.unknown_service_hint(asked, [entry(*offered)])
    assert told.startswith(hint)
    assert "/n/" not in told or "/n/" in hint


def test_hint_about_a_remote_program_does_not_mention_this_machine():
    hint = graph.unknown_service_hint("/x", [], Remote("robot:7450"))
    assert hint == "the program at robot:7450 offers no service"


def test_hint_about_another_transport_does_not_mention_this_machine():
    hint = graph.unknown_service_hint("/x", [], Remote("robot:7447", transport="zenoh"))
    assert hint == "no program offers a service over zenoh in domain 0"


def test_services_are_sorted_with_all_their_types():
    entries = [entry("/b", "/_h"), entry("/a"), entry("/b", type_name="z/srv/Z")]
    assert suggestions.services(entries) == {"/a": ["a/srv/A"], "/b": ["a/srv/A", "z/srv/Z"]}
    assert "/_h" in suggestions.services(entries, hidden=True)


def test_gids_equal_those_of_rclpy_programs():
    from taskrpc.ros.packages.rclpy._impl.graph import endpoints as rclpy
    from taskrpc.ros.packages.rclpy.endpoint_info import EndpointTypeEnum

    hash_ = "RIHS01_" + "0" * 64
    topic = TopicEndpoint("/t", "a/msg/A", hash_, "/n", 1, True, False)
    service = ServiceEndpoint("/s", "a/srv/A", hash_, "/n")
    one = RegistryEntry(
        7,
        "s.py",
        "/",
        0.0,
        services=(service,),
        clients=(service,),
        publishers=(topic,),
        subscriptions=(topic,),
    )
    seen = [
        *rclpy.topic_endpoints([one], EndpointTypeEnum.PUBLISHER, "/t"),
        *rclpy.topic_endpoints([one], EndpointTypeEnum.SUBSCRIPTION, "/t"),
        *rclpy.service_endpoints([one], EndpointTypeEnum.CLIENT, "/s"),
        *rclpy.service_endpoints([one], EndpointTypeEnum.SERVER, "/s"),
    ]
    shown = [graph.gid(one, topic, kind) for kind in (1, 2)]
    shown += [graph.gid(one, service, kind) for kind in (3, 4)]
    for info, gid in zip(seen, shown, strict=True):
        assert f"GID: {gid}\n" in str(info)
    assert len(set(shown)) == 4


class SlowGraph:
    """A node that sees a program after `delay` seconds."""

    def __init__(self, delay: float) -> None:
        self.began = asyncio.get_running_loop().time()
        self.delay = delay

    @property
    def passed(self) -> float:
        return asyncio.get_running_loop().time() - self.began

    async def graph(self) -> list[RegistryEntry]:
        return [entry("/door")] if self.passed >= self.delay else []


async def test_command_waits_until_a_middleware_has_found_the_first_program():
    node = SlowGraph(1.0)
    (found,) = await graph.entries_of(Remote(transport="ros"), node)
    assert found.offers("/door")
    assert node.passed < 1.2


async def test_command_waits_two_seconds_for_a_middleware_without_programs():
    node = SlowGraph(60.0)
    assert await graph.entries_of(Remote(transport="ros"), node) == []
    assert node.passed == pytest.approx(2.0, abs=0.2)


async def test_command_over_tcp_does_not_wait():
    node = SlowGraph(1.0)
    assert await graph.entries_of(Remote(), node) == []
    assert node.passed == 0
