"""Nodes on the network, and an executor that spins them."""

from __future__ import annotations

import contextlib
import time

import srvgen
from taskrpc.ros.packages.rclpy.context import Context
from taskrpc.ros.packages.rclpy.executors import SingleThreadedExecutor
from taskrpc.ros.packages.rclpy.node import Node

PATIENCE = 60
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")


def add(request, response):
    response.sum = request.a + request.b
    return response


@contextlib.contextmanager
def context_of(*line):
    context = Context()
    context.init(["program", *line])
    try:
        yield context
    finally:
        context.try_shutdown()


class World:
    """Nodes of one context, all of them in one executor."""

    def __init__(self, context):
        self.context = context
        self.executor = SingleThreadedExecutor(context=context)

    def node(self, name="robot", **settings):
        settings.setdefault("start_parameter_services", False)
        node = Node(name, context=self.context, **settings)
        self.executor.add_node(node)
        return node

    def answer(self, future):
        """Spin until the future is done; returns its result."""
        self.executor.spin_until_future_complete(future, PATIENCE)
        assert future.done()
        return future.result()

    def spin_until(self, happened):
        end = time.monotonic() + PATIENCE
        while not happened():
            assert time.monotonic() < end, "it did not happen"
            self.executor.spin_once(0.05)


@contextlib.contextmanager
def living(*line):
    with context_of(*line) as context:
        world = World(context)
        yield world
        world.executor.shutdown()


def service_of(node, name):
    """Return a node's service by its absolute name."""
    return next(service for service in node.services if service.service_name == name)


def until(happened):
    """Wait until other threads have made the condition true."""
    end = time.monotonic() + PATIENCE
    while not happened():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.001)
