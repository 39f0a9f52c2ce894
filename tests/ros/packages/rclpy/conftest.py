"""Contexts, executors and nodes for tests of the rclpy layer."""

from __future__ import annotations

import weakref

import pytest

from taskrpc.ros.packages.rclpy import logging
from taskrpc.ros.packages.rclpy._impl.log import output
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.node import Node
from taskrpc.ros.packages.rclpy.parameter import Parameter
from taskrpc.ros.packages.rclpy.parameter_client import AsyncParameterClient
from tests.ros.packages.rclpy.fakes import FakeNode
from tests.ros.packages.rclpy.living import PATIENCE, AddTwoInts, add, living
from tests.ros.packages.rclpy.programs.running import domain_in, programs_in


@pytest.fixture
def context():
    context = Context()
    context.init([])
    yield context
    context.try_shutdown()


@pytest.fixture
def fake(context):
    return FakeNode(context)


@pytest.fixture
def executor(context, fake):
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(fake)
    yield executor
    executor.shutdown()


@pytest.fixture
def world():
    """Nodes that live on the network."""
    with living() as world:
        yield world


@pytest.fixture
def client(world):
    """A client of a service that adds."""
    world.node("server").create_service(AddTwoInts, "add", add)
    client = world.node("caller").create_client(AddTwoInts, "add")
    assert client.wait_for_service(PATIENCE)
    return client


class Pair:
    """A node with parameters, a client of these, and an executor that spins both nodes."""

    def __init__(self, context):
        self.target = Node("target", namespace="/ns", context=context)
        self.target.declare_parameters("", [("speed", 1.5), ("names", ["a", "b"]), ("g.x", [1, 2])])
        self.asking = Node("asking", namespace="/ns", context=context)
        self.client = AsyncParameterClient(self.asking, "target")
        self.executor = SingleThreadedExecutor(context=context)
        self.executor.add_node(self.target)
        self.executor.add_node(self.asking)

    def answer(self, future):
        self.executor.spin_until_future_complete(future, timeout_sec=10)
        return future.result()

    def set(self, **values):
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        results = self.answer(self.client.set_parameters(parameters)).results
        return [(one.successful, one.reason) for one in results]

    def spin_until(self, done):
        for _ in range(200):
            if done():
                return
            self.executor.spin_once(timeout_sec=0.05)
        raise AssertionError("it did not happen")


@pytest.fixture
def pair(context):
    pair = Pair(context)
    assert pair.client.wait_for_services(10)
    yield pair
    pair.executor.shutdown()


@pytest.fixture
def fresh_log(monkeypatch):
    """The log as at the start of a program: no levels, no outputs, no format."""
    for name in ("OUTPUT_FORMAT", "STDOUT_LINE_BUFFERED"):
        monkeypatch.delenv(f"RCUTILS_CONSOLE_{name}", raising=False)
    monkeypatch.setattr(output, "_owners", weakref.WeakSet())
    logging.shutdown()
    yield
    logging.shutdown()


@pytest.fixture
def ros(tmp_path, monkeypatch):
    """Starts programs with `taskrpc run`, in an empty folder and a domain of their own."""
    for name, value in domain_in(tmp_path).items():
        monkeypatch.setenv(name, value)
    with programs_in(tmp_path) as start:
        yield start


@pytest.fixture
def run(ros):
    """Runs a program to its end: its exit status, stdout and stderr."""

    def run(source, *arguments, name="program.py"):
        program = ros(source, *arguments, name=name)
        code = program.end()
        return code, program.out, program.err

    return run
