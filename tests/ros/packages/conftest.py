"""The names of ROS packages, for tests of the packages that taskrpc contains."""

import importlib
import os
import sys

import pytest

from srvgen.classes import importer, loader
from srvgen.files.search import BUNDLED
from taskrpc.ros import bundled, hook

_kept = {}
"""The modules with ROS names, between tests: importing them again takes half a second."""
_built, _loaded = {}, {}
"""The loader's classes for programs for ROS, likewise."""


@pytest.fixture
def ros_names(tmp_path, monkeypatch):
    """Import ROS packages by their names, as programs do, until the end of the test."""
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    monkeypatch.setattr(loader, "_runtime_module", loader._runtime_module)
    monkeypatch.setattr(loader, "_built", _built)
    monkeypatch.setattr(loader, "_loaded", _loaded)
    importer.uninstall_import_hook()
    explaining = (hook._explaining_ros, hook._explaining_interfaces)
    for finder in (hook._finder, hook._workspace, *explaining):
        while finder in sys.meta_path:
            sys.meta_path.remove(finder)
    hook.install(tmp_path)
    sys.modules.update(_kept)
    yield
    for name in [name for name in sys.modules if _has_ros_name(name)]:
        _kept[name] = sys.modules.pop(name)
    importer.uninstall_import_hook()


def _has_ros_name(name):
    top = name.partition(".")[0]
    return top == "rclpy" or top in bundled.packages() or (BUNDLED / top).is_dir()


@pytest.fixture
def launch(ros_names, tmp_path, monkeypatch):
    """The package `launch`, with its log files in a temporary folder."""
    package = importlib.import_module("launch")
    monkeypatch.setattr(package.logging, "_log_root", lambda: tmp_path / "log")
    before = dict(os.environ)
    yield package
    package.logging.launch_config.close()
    os.environ.clear()
    os.environ.update(before)


@pytest.fixture
def play(launch, capsys):
    """Executes entities to their end: the exit code, and the lines on the screen."""

    async def play(*entities, **configurations):
        service = launch.LaunchService()
        service.context.launch_configurations.update(configurations)
        service.include_launch_description(launch.LaunchDescription(entities))
        code = await service.run_async()
        return code, capsys.readouterr().out.splitlines()

    return play


@pytest.fixture
def perform(launch):
    """Computes a substitution, with these launch configurations."""

    def perform(substitution, **configurations):
        context = launch.LaunchContext()
        context.launch_configurations.update(configurations)
        return launch.substitution.perform(context, substitution)

    return perform
