"""What is different in a notebook, whose cells run again."""

import signal

import pytest

from taskrpc.ros.packages import rclpy
from taskrpc.ros.packages.rclpy._impl import cells
from taskrpc.ros.packages.rclpy.utilities import get_default_context


class Cells:
    def __init__(self):
        self.joined = []

    def node_joins(self, node, name):
        self.joined.append(name)


@pytest.fixture
def notebook(monkeypatch):
    monkeypatch.setattr(cells, "current", Cells())
    yield cells.current
    rclpy.try_shutdown()


def test_init_may_be_repeated(notebook):
    rclpy.init(args=[])
    context = get_default_context()
    rclpy.init(args=[])
    assert rclpy.ok()
    assert get_default_context() is context


def test_init_works_again_after_shutdown(notebook):
    rclpy.init(args=[])
    rclpy.shutdown()
    rclpy.init(args=[])
    assert rclpy.ok()


def test_interrupting_a_cell_leaves_the_nodes_alone(notebook):
    before = signal.getsignal(signal.SIGINT)
    rclpy.init(args=[])
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.real_time
def test_a_node_is_announced_by_its_full_name(notebook):
    rclpy.init(args=[])
    rclpy.create_node("adder", namespace="lab").destroy_node()
    assert notebook.joined == ["/lab/adder"]


def test_a_program_may_not_repeat_init():
    rclpy.init(args=[])
    try:
        with pytest.raises(RuntimeError, match="only be called once"):
            rclpy.init(args=[])
    finally:
        rclpy.shutdown()
