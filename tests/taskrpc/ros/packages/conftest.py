"""The names of ROS packages, for tests of the packages that taskrpc contains."""

import sys

import pytest

from srvgen.classes import importer, loader
from taskrpc.ros import bundled, hook


@pytest.fixture
def ros_names(tmp_path, monkeypatch):
    """Import ROS packages by their names, as programs do; forgets them after the test."""
    monkeypatch.setattr(sys, "meta_path", list(sys.meta_path))
    monkeypatch.setattr(sys, "modules", dict(sys.modules))
    monkeypatch.setattr(loader, "_runtime_module", loader._runtime_module)
    importer.uninstall_import_hook()
    explaining = (hook._explaining_ros, hook._explaining_interfaces)
    for finder in (hook._finder, hook._workspace, *explaining):
        while finder in sys.meta_path:
            sys.meta_path.remove(finder)
    hook.install(tmp_path)
    yield
    importer.uninstall_import_hook()
    for name in list(sys.modules):
        if name.partition(".")[0] in bundled.packages():
            del sys.modules[name]
