"""The programs on the slides of the lecture, unchanged."""

import re
from pathlib import Path

import pytest

LECTURE = Path(__file__).parents[6] / "shared" / "lecture" / "week4.txt"

SNIPPETS = """
import time

import rclpy
from rclpy.node import Node
from example_interfaces.srv import AddTwoInts


class Caller(Node):
    def __init__(self):
        super().__init__("caller")
        self.client = self.create_client(AddTwoInts, "add_two_ints")

    {method}

rclpy.init()
node = Caller()
if {waits}:
    node.client.wait_for_service(timeout_sec=60.0)
print(node.{call})
node.destroy_node()
rclpy.shutdown()
"""


def _text():
    if not LECTURE.exists():
        pytest.skip("the lecture is not here")
    return LECTURE.read_text(encoding="utf-8")


def listing(name):
    """Return a program of the lecture."""
    return re.search(rf"^{name}\b.*\n(#!/usr(?:.*\n)+?    main\(\)\n)", _text(), re.M)[1]


def program_of(method, arguments, *, waits=True):
    """Return a program that calls a method of the lecture; `waits`: for its service, before."""
    found = re.search(rf"^def {method}(?:.*\n)+?    return None\n", _text(), re.M)[0]
    indented = found.replace("\n", "\n    ")
    call = f"{method}({arguments})"
    return SNIPPETS.format(method=indented, waits=waits, call=call)
