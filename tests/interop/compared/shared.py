"""Printing for the compared programs."""

import os
import sys
import time

import rclpy
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor


def attempt(what, action):
    """Print the result of an action, or the class and the text of its exception."""
    try:
        result = repr(action())
    except Exception as error:
        result = f"{type(error).__name__}: {str(error).partition(', at /')[0]}"
    print(f"{what}: {result}".replace("\n", "|"), flush=True)


def fails(what, action):
    """Print the class of the exception only: its text differs on purpose."""
    try:
        print(f"{what}: {action()!r}", flush=True)
    except Exception as error:
        print(f"{what}: {type(error).__name__}", flush=True)


def milliseconds(count):
    """A duration."""
    return Duration(nanoseconds=count * 1_000_000)


class Robot:
    """A node and the executor that spins it."""

    def __init__(self, name="compared", **settings):
        self.node = rclpy.create_node(name, **settings)
        self.executor = SingleThreadedExecutor()
        self.executor.add_node(self.node)

    def spin(self, seconds):
        """Spin for a time."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self.executor.spin_once(timeout_sec=min(left, 0.05))

    def until(self, happened, seconds=20.0):
        """Spin until something has happened."""
        end = time.monotonic() + seconds
        while not happened():
            if time.monotonic() > end:
                print("it did not happen", flush=True)
                return
            self.executor.spin_once(timeout_sec=0.05)


def end():
    """End at once: a real ROS program may hang at its end."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)
