"""Calls the methods of rclpy after the shutdown, and prints what each returns or raises.

`python ros_after_shutdown_program.py shutdown` ends the context with `rclpy.shutdown()`,
`python ros_after_shutdown_program.py signal` with SIGTERM. The program runs on the real rclpy
and on taskrpc's, so it uses only names that both have.
"""

from __future__ import annotations

import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from typing import Any

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.task import Future
from rclpy.wait_for_message import wait_for_message
from std_msgs.msg import String
from std_srvs.srv import Trigger
from test_msgs.action import Fibonacci

LIMIT = 5.0
"""Seconds after which a call counts as waiting for ever."""


def answer(request, response):
    """The callback of the service."""
    return response


def execute(goal):
    """The callback of the action."""
    goal.succeed()
    return Fibonacci.Result()


def shown(result: Any) -> str:
    """A result without addresses and times."""
    if result is None or isinstance(result, (bool, int, str, list, tuple, dict)):
        return repr(result)
    return type(result).__name__


def outcome(call: Callable[[], Any]) -> str:
    """What a call returns or raises, or that it does not end."""
    found: list[str] = []

    def run() -> None:
        try:
            found.append(f"returns {shown(call())}")
        except BaseException as error:
            text = " ".join(str(error).split(", at ")[0].split())
            found.append(f"raises {type(error).__name__}: {text}")

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(LIMIT)
    return found[0] if found else "waits for ever"


def node_calls(node: Any, other: Any) -> dict[str, Callable[[], Any]]:
    """The methods of a node."""
    group = node.default_callback_group
    return {
        "create_publisher": lambda: node.create_publisher(String, "new", 1),
        "create_subscription": lambda: node.create_subscription(String, "new", print, 1),
        "create_client": lambda: node.create_client(Trigger, "new"),
        "create_service": lambda: node.create_service(Trigger, "new", answer),
        "create_timer": lambda: node.create_timer(1.0, print),
        "create_rate": lambda: node.create_rate(1.0),
        "create_guard_condition": lambda: node.create_guard_condition(print),
        "declare_parameter": lambda: node.declare_parameter("new", 1),
        "declare_parameters": lambda: node.declare_parameters("", [("newer", 1)]),
        "has_parameter": lambda: node.has_parameter("old"),
        "get_parameter": lambda: node.get_parameter("old").value,
        "get_parameters": lambda: len(node.get_parameters(["old"])),
        "get_parameter_or": lambda: node.get_parameter_or("old").value,
        "describe_parameter": lambda: node.describe_parameter("old"),
        "list_parameters": lambda: node.list_parameters([], 1),
        "set_parameters": lambda: node.set_parameters([Parameter("old", value=2)])[0].successful,
        "set_parameters_atomically": lambda: (
            node.set_parameters_atomically([Parameter("old", value=3)]).successful
        ),
        "undeclare_parameter": lambda: node.undeclare_parameter("old"),
        "add_on_set_parameters_callback": lambda: node.add_on_set_parameters_callback(print),
        "get_name": node.get_name,
        "get_namespace": node.get_namespace,
        "get_fully_qualified_name": node.get_fully_qualified_name,
        "get_clock": node.get_clock,
        "get_clock.now": lambda: node.get_clock().now(),
        "get_logger": lambda: node.get_logger().get_effective_level(),
        "get_node_names": node.get_node_names,
        "get_node_names_and_namespaces": node.get_node_names_and_namespaces,
        "get_topic_names_and_types": node.get_topic_names_and_types,
        "get_service_names_and_types": node.get_service_names_and_types,
        "get_publisher_names_and_types_by_node": (
            lambda: node.get_publisher_names_and_types_by_node("probe", "/")
        ),
        "get_client_names_and_types_by_node": (
            lambda: node.get_client_names_and_types_by_node("probe", "/")
        ),
        "count_publishers": lambda: node.count_publishers("talk"),
        "count_subscribers": lambda: node.count_subscribers("talk"),
        "count_clients": lambda: node.count_clients("serve"),
        "count_services": lambda: node.count_services("serve"),
        "get_publishers_info_by_topic": lambda: node.get_publishers_info_by_topic("talk"),
        "get_subscriptions_info_by_topic": lambda: node.get_subscriptions_info_by_topic("talk"),
        "resolve_topic_name": lambda: node.resolve_topic_name("talk"),
        "resolve_service_name": lambda: node.resolve_service_name("serve"),
        "wait_for_node": lambda: node.wait_for_node("absent", 0.2),
        "context.ok": lambda: node.context.ok(),
        "publishers": lambda: len(list(node.publishers)) > 0,
        "clients": lambda: len(list(node.clients)) > 0,
        "default_callback_group": lambda: group is node.default_callback_group,
        "destroy_node of another": other.destroy_node,
    }


def entity_calls(made: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """The methods of the entities of a node."""
    client, service, publisher = made["client"], made["service"], made["publisher"]
    subscription, timer, guard = made["subscription"], made["timer"], made["guard"]
    action_client, action_server = made["action client"], made["action server"]
    goal = Fibonacci.Goal(order=1)
    return {
        "Client.service_is_ready": client.service_is_ready,
        "Client.wait_for_service(0)": lambda: client.wait_for_service(0.0),
        "Client.wait_for_service(1)": lambda: client.wait_for_service(1.0),
        "Client.wait_for_service()": client.wait_for_service,
        "Client.call_async": lambda: client.call_async(Trigger.Request()),
        "Client.call(timeout)": lambda: client.call(Trigger.Request(), timeout_sec=0.5),
        "Client.remove_pending_request": lambda: client.remove_pending_request(Future()),
        "Client.service_name": lambda: client.service_name,
        "Client.logger_name": lambda: client.logger_name,
        "Service.service_name": lambda: service.service_name,
        "Service.logger_name": lambda: service.logger_name,
        "Publisher.publish": lambda: publisher.publish(String()),
        "Publisher.get_subscription_count": publisher.get_subscription_count,
        "Publisher.topic_name": lambda: publisher.topic_name,
        "Publisher.assert_liveliness": publisher.assert_liveliness,
        "Publisher.wait_for_all_acked": lambda: publisher.wait_for_all_acked(Duration(seconds=0.1)),
        "Subscription.topic_name": lambda: subscription.topic_name,
        "Subscription.get_publisher_count": subscription.get_publisher_count,
        "Timer.is_ready": timer.is_ready,
        "Timer.time_until_next_call": lambda: timer.time_until_next_call() is None,
        "Timer.time_since_last_call": lambda: timer.time_since_last_call() > 0,
        "Timer.timer_period_ns": lambda: timer.timer_period_ns,
        "Timer.is_canceled": timer.is_canceled,
        "Timer.reset": timer.reset,
        "Timer.cancel": timer.cancel,
        "GuardCondition.trigger": guard.trigger,
        "Rate.sleep": made["rate"].sleep,
        "ActionClient.server_is_ready": action_client.server_is_ready,
        "ActionClient.wait_for_server(0)": lambda: action_client.wait_for_server(0.0),
        "ActionClient.wait_for_server(1)": lambda: action_client.wait_for_server(1.0),
        "ActionClient.wait_for_server()": action_client.wait_for_server,
        "ActionClient.send_goal_async": lambda: action_client.send_goal_async(goal),
        "ActionServer.register_execute_callback": (
            lambda: action_server.register_execute_callback(execute)
        ),
        "parameter client wait_for_services": (
            lambda: made["parameter client"].wait_for_services(0.5)
        ),
        "parameter client services_are_ready": made["parameter client"].services_are_ready,
        "parameter client list_parameters": lambda: made["parameter client"].list_parameters(),
    }


def waits(node: Any, made: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """Waiting functions, executors and clocks."""
    clock = node.get_clock()
    single, pool = made["executor"], made["pool"]
    return {
        "rclpy.ok": rclpy.ok,
        "create_node": lambda: rclpy.create_node("late"),
        "ActionClient()": lambda: ActionClient(node, Fibonacci, "new"),
        "ActionServer()": lambda: ActionServer(node, Fibonacci, "new", execute),
        "AsyncParameterClient()": lambda: AsyncParameterClient(node, "other"),
        "spin": lambda: rclpy.spin(node),
        "spin_once": lambda: rclpy.spin_once(node, timeout_sec=0.2),
        "spin_once()": lambda: rclpy.spin_once(node),
        "spin_until_future_complete": lambda: rclpy.spin_until_future_complete(node, Future()),
        "spin_until_future_complete(timeout)": (
            lambda: rclpy.spin_until_future_complete(node, Future(), timeout_sec=0.2)
        ),
        "wait_for_message": lambda: wait_for_message(String, node, "talk", time_to_wait=0.2),
        "executor.spin": single.spin,
        "executor.spin_once": lambda: single.spin_once(timeout_sec=0.2),
        "executor.spin_until_future_complete": lambda: single.spin_until_future_complete(Future()),
        "executor.create_task": lambda: single.create_task(print),
        "executor.add_node": lambda: single.add_node(node),
        "executor.get_nodes": lambda: len(single.get_nodes()) > 0,
        "executor.wake": single.wake,
        "pool.spin": pool.spin,
        "pool.spin_once": lambda: pool.spin_once(timeout_sec=0.2),
        "pool.spin_until_future_complete": lambda: pool.spin_until_future_complete(Future()),
        "SingleThreadedExecutor()": SingleThreadedExecutor,
        "MultiThreadedExecutor()": lambda: MultiThreadedExecutor(2),
        "clock.now": clock.now,
        "clock.sleep_for": lambda: clock.sleep_for(Duration(seconds=0.1)),
        "clock.sleep_until": lambda: clock.sleep_until(clock.now() + Duration(seconds=0.1)),
        "Clock()": lambda: rclpy.clock.Clock(clock_type=ClockType.STEADY_TIME).now(),
        "executor.shutdown": single.shutdown,
        "pool.shutdown": pool.shutdown,
    }


def destructions(node: Any, made: dict[str, Any]) -> dict[str, Callable[[], Any]]:
    """What a program calls at its end."""
    return {
        "destroy_publisher": lambda: node.destroy_publisher(made["publisher"]),
        "destroy_subscription": lambda: node.destroy_subscription(made["subscription"]),
        "destroy_client": lambda: node.destroy_client(made["client"]),
        "destroy_service": lambda: node.destroy_service(made["service"]),
        "destroy_timer": lambda: node.destroy_timer(made["timer"]),
        "destroy_rate": lambda: node.destroy_rate(made["rate"]),
        "destroy_guard_condition": lambda: node.destroy_guard_condition(made["guard"]),
        "ActionClient.destroy": made["action client"].destroy,
        "ActionServer.destroy": made["action server"].destroy,
        "destroy_node": node.destroy_node,
        "destroy_node again": node.destroy_node,
        "shutdown": rclpy.shutdown,
        "try_shutdown": rclpy.try_shutdown,
        "init": lambda: type(rclpy.init()).__name__,
        "create_node after init": lambda: type(rclpy.create_node("again")).__name__,
        "shutdown after init": rclpy.shutdown,
    }


def entities(node: Any) -> dict[str, Any]:
    """One entity of each kind."""
    return {
        "client": node.create_client(Trigger, "absent"),
        "service": node.create_service(Trigger, "serve", answer),
        "publisher": node.create_publisher(String, "talk", 1),
        "subscription": node.create_subscription(String, "talk", print, 1),
        "timer": node.create_timer(100.0, print),
        "rate": node.create_rate(0.01),
        "guard": node.create_guard_condition(print),
        "action client": ActionClient(node, Fibonacci, "missing"),
        "action server": ActionServer(node, Fibonacci, "count", execute),
        "parameter client": AsyncParameterClient(node, "nobody"),
        "executor": SingleThreadedExecutor(),
        "pool": MultiThreadedExecutor(2),
    }


def end(how: str) -> None:
    """Shut the default context down."""
    if how == "shutdown":
        rclpy.shutdown()
        return
    os.kill(os.getpid(), signal.SIGTERM)
    limit = time.monotonic() + 60
    while rclpy.ok():
        if time.monotonic() > limit:
            raise SystemExit("the signal did not shut the context down")
        time.sleep(0.01)


def main(how: str) -> None:
    """Print one line for each call."""
    rclpy.init()
    node, other = rclpy.create_node("probe"), rclpy.create_node("other")
    node.declare_parameter("old", 1)
    made = entities(node)
    end(how)
    groups = (
        entity_calls(made),
        waits(node, made),
        node_calls(node, other),
        destructions(node, made),
    )
    for calls in groups:
        for name, call in calls.items():
            print(f"{name}: {outcome(call)}", flush=True)
    os._exit(0)  # a call that waits for ever must not keep the program


if __name__ == "__main__":
    main(sys.argv[1])
