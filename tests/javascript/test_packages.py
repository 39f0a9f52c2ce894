"""Which packages of npm run in which Node."""

import json
import subprocess

import pytest

from tests.javascript import packages
from tests.javascript.packages import FOLDER, node_for, obstacle

LOCK = json.loads((FOLDER / "package-lock.json").read_text(encoding="utf-8"))


@pytest.mark.parametrize("node", ["v20.0.0", "v20.20.2", "v22.1.0"])
@pytest.mark.parametrize("package", ["roslib", "roslib-1"])
def test_new_node_runs_both_versions_of_roslib(package, node):
    assert obstacle(package, node, LOCK) == ""


@pytest.mark.parametrize("node", ["v18.20.4", "v18.19.0", "v19.9.0"])
def test_node_of_debian_runs_only_the_old_roslib(node):
    assert obstacle("roslib-1", node, LOCK) == ""
    assert obstacle("roslib", node, LOCK) == (
        f"roslib needs Node 20 or newer, got {node}; install a newer Node"
    )


def test_test_with_a_package_for_a_newer_node_is_skipped_on_a_ci_machine_too(monkeypatch):
    def version(command, **_):
        return subprocess.CompletedProcess(command, 0, stdout="v18.20.4\n")

    monkeypatch.setenv("CI", "1")
    monkeypatch.setattr(packages, "program", lambda *names, package: "/usr/bin/node")
    monkeypatch.setattr(packages.subprocess, "run", version)
    assert node_for("roslib-1") == "/usr/bin/node"
    with pytest.raises(pytest.skip.Exception, match="roslib needs Node 20"):
        node_for("roslib")
