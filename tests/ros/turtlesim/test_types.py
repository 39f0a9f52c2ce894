"""The programs of turtlesim use the types of `turtlesim`, or of `turtlesim_msgs` on demand."""

import importlib
import sys

import pytest

import taskrpc


@pytest.fixture
def load(monkeypatch):
    """Load the module with a value of the variable, and packages that only have names."""

    def load(package):
        def named(module):
            return type("Types", (), {"__getattr__": lambda _, name: f"{module}.{name}"})()

        monkeypatch.setenv("TASKRPC_TURTLESIM_TYPES", package)
        monkeypatch.setattr(sys, "excepthook", sys.excepthook)
        monkeypatch.delitem(sys.modules, "taskrpc.ros.turtlesim.types", raising=False)
        for name in ("turtlesim", "turtlesim_msgs"):
            for module in (name, f"{name}.action", f"{name}.msg", f"{name}.srv"):
                monkeypatch.setitem(sys.modules, module, named(module))
        return importlib.import_module("taskrpc.ros.turtlesim.types")

    yield load
    sys.modules.pop("taskrpc.ros.turtlesim.types", None)


@pytest.mark.parametrize(
    ("value", "package"),
    [("", "turtlesim"), ("turtlesim", "turtlesim"), ("turtlesim_msgs", "turtlesim_msgs")],
)
def test_variable_chooses_the_package(load, value, package):
    types = load(value)
    assert types.Pose == f"{package}.msg.Pose"
    assert types.Spawn == f"{package}.srv.Spawn"
    assert types.RotateAbsolute == f"{package}.action.RotateAbsolute"


def test_unknown_package_is_refused(load):
    with pytest.raises(taskrpc.TaskRpcError, match="expected turtlesim or turtlesim_msgs, got x"):
        load("x")
