"""The methods of `Node` for parameters call `NodeParameters`; rclpy's private names work too."""

import inspect

import pytest

from taskrpc.ros.packages.rclpy._impl.parameters.node_methods import ParameterMethods
from taskrpc.ros.packages.rclpy._impl.parameters.node_parameters import NodeParameters
from taskrpc.ros.packages.rclpy.node import Node

METHODS = [name for name in vars(ParameterMethods) if not name.startswith("_") and name.islower()]


class Recorder:
    """Keeps the last call of any method."""

    def __getattr__(self, method):
        def called(*arguments):
            self.last = method, arguments
            return method

        return called


@pytest.mark.parametrize("method", METHODS)
def test_method_passes_its_arguments_on_in_order(method):
    signature = inspect.signature(getattr(ParameterMethods, method))
    assert signature.parameters == inspect.signature(getattr(NodeParameters, method)).parameters
    node, arguments = ParameterMethods(), tuple(signature.parameters)[1:]
    node._rclpy_parameters = recorder = Recorder()
    returned = getattr(node, method)(*arguments)
    assert recorder.last == (method, arguments)
    assert returned == (None if signature.return_annotation == "None" else method)


def test_private_names_of_rclpy_are_the_parameters_of_the_node(context):
    node = Node("arm", context=context)
    node.declare_parameter("speed", 1.0)
    assert node._parameters["speed"] is node.get_parameter("speed")
    assert node._descriptors["speed"].name == "speed"
    assert node._parameters_callbacks is node._on_set_parameters_callbacks
