"""The transports that run the contract suite, and what each of them lacks.

A new transport needs one line in `CASES`. Its name in the ids of the tests is that of the case.
"""

from __future__ import annotations

import asyncio
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, NamedTuple

from taskrpc.testing import VirtualTimeLoop


class Case(NamedTuple):
    """One way to run the contract suite."""

    transport: str
    """The value of `transport=`."""
    loop: type[asyncio.AbstractEventLoop]
    opener: str = ""
    """Registers the transport for the tests; "" if taskrpc itself does."""
    settings: Mapping[str, Any] = {}
    """Arguments of each node, unless the test gives others."""
    apart: str = "token"
    """The argument that gives a node an endpoint of its own; nodes with equal ones share one."""
    lacks: Mapping[str, str] = {}
    """Tests that are left out, with the reason. They are no expected failures: whether such a test
    fails may depend on how busy the machine is. Other tests state the differences."""
    needs: str = ""
    """A module without which the case is skipped."""
    by_address: bool = False
    """Whether nodes with other secrets need the server's address."""
    shares_secrets: bool = False
    """Whether the programs of one user find each other's secrets in the registry."""
    mark: str = ""
    """A mark of all its tests, "" if the quick suite runs them."""


MEMORY_ENGINE = "taskrpc.testing.memory_engine:open_network"
VIRTUAL, REAL = VirtualTimeLoop, asyncio.SelectorEventLoop

NATIVE_TOPICS = dict.fromkeys(
    (
        "test_a_call_is_heard_beside_a_flood_that_is_never_read_up",
        "test_a_caller_with_too_many_subscriptions_is_disconnected_alone",
        "test_a_lost_subscriber_leaves_no_waiting_messages",
        "test_a_peer_that_closes_connections_is_dialled_at_growing_intervals",
        "test_a_peer_that_falls_silent_before_it_responds_is_asked_again",
        "test_a_program_has_so_many_subscriptions_at_another_and_no_more",
        "test_a_slow_subscriber_does_not_delay_others",
        "test_a_slow_subscriber_gets_the_newest_messages_up_to_the_depth",
        "test_destroyed_publishers_leave_nothing_for_a_slow_subscriber",
        "test_many_subscriptions_made_at_once_look_for_publishers_together",
        "test_publishers_of_one_turn_are_announced_together_before_their_messages",
        "test_the_other_topics_of_a_connection_take_turns",
        "test_waiting_messages_are_bounded_in_bytes",
        "test_waiting_messages_of_a_destroyed_publisher_count_as_lost",
    ),
    "the middleware carries the topics: no connection of taskrpc has queues and limits for them",
)
"""What every transport with native topics lacks."""

FOREIGN_TOPICS = NATIVE_TOPICS | {
    "test_publishers_of_one_topic_never_share_a_number": "the middleware's publishers have no"
    " numbers of taskrpc",
    "test_a_subscription_knows_whether_its_publishers_are_alive": "the middleware does not pass on"
    " whether publishers are alive",
}
"""What a transport lacks, too, whose topics are not taskrpc's own, as in the memory engine."""

ZENOH_TOPICS = FOREIGN_TOPICS | dict.fromkeys(
    (
        "test_a_mismatch_callback_replaces_the_log_line",
        "test_both_ends_report_incompatible_qos",
        "test_mismatches_that_a_peer_makes_up_do_not_fill_the_log",
    ),
    "as with rmw_zenoh, all QoS profiles are compatible",
)

ROS_PROGRAMS = {
    "test_an_unknown_service_answers_at_once": "a call waits for a server in the first seconds of a"
    " program, while DDS finds the others",
    "test_many_clients_of_many_servers_are_all_answered": "Fast DDS needs up to a minute until"
    " all of its 23 programs know each other",
    "test_a_program_that_names_itself_among_its_peers_gets_its_messages_once": "programs are found"
    " by their presence, not by addresses",
}
"""What programs on ROS lack, with any topics."""

ROS_TOPICS = FOREIGN_TOPICS | {
    "test_a_callback_that_holds_the_loop_is_named_once": "it counts all warnings, and one says that"
    " ROS has not built the package",
    "test_both_ends_report_a_different_type": "DDS does not report another type of a topic",
    "test_mismatches_that_a_peer_makes_up_do_not_fill_the_log": "DDS reports several mismatches"
    " as one",
    "test_a_mismatch_callback_replaces_the_log_line": "DDS reports several mismatches as one",
    "test_a_peer_of_before_there_were_topics_is_asked_once_and_can_be_called": "no connection of"
    " taskrpc carries topics",
    "test_a_plain_callback_that_is_too_slow_gets_the_newest_and_the_loop_goes_on": "on a busy"
    " machine, rclpy may read no faster than the callback",
}

ZENOH = Case("zenoh", REAL, apart="listen", mark="interop", needs="zenoh")
CASES = {
    "memory": Case("memory", VIRTUAL, shares_secrets=True),
    "tcp": Case("tcp", REAL, by_address=True, shares_secrets=True),
    "tunnel": Case("tunnel", VIRTUAL, MEMORY_ENGINE, {"token": "secret"}, "listen"),
    "native": Case("tunnel", VIRTUAL, MEMORY_ENGINE, {}, "listen", NATIVE_TOPICS),
    "zenoh": ZENOH._replace(settings={"token": "secret"}),
    "zenoh native": ZENOH._replace(lacks=ZENOH_TOPICS),
}
if find_spec("rclpy") and find_spec("rclpy._rclpy_pybind11"):  # the real one
    ROS = Case("ros", REAL, mark="interop")
    CASES["ros"] = ROS._replace(
        settings={"token": "secret"},
        apart="listen",
        lacks=ROS_PROGRAMS,
    )
    CASES["native ros"] = ROS._replace(apart="listen", lacks=ROS_PROGRAMS | ROS_TOPICS)
if find_spec("uvloop"):
    from uvloop import Loop  # `new_event_loop`, which programs use, is a function: no base class

    CASES["tcp on uvloop"] = CASES["tcp"]._replace(loop=Loop)

LOOPS = {name: type(f"Loop of {name}", (case.loop,), {}) for name, case in CASES.items()}
"""A class of event loops for each case, so that a test finds its case by its loop."""


def case_of(loop: type[asyncio.AbstractEventLoop]) -> str:
    """Return the name of the case whose class of event loops this is; "" for any other class."""
    return next((name for name, each in LOOPS.items() if each is loop), "")
