"""`taskrpc doctor` reports why a program does not join Zenoh or ROS 2."""

from __future__ import annotations

import json
from importlib.metadata import PackageNotFoundError
from types import SimpleNamespace

import pytest

import srvgen
import taskrpc.sync
from taskrpc.cli.main import main
from taskrpc.cli.ros.doctor import middlewares
from taskrpc.cli.shared.remote import Remote
from taskrpc.core.security.installing import install_command
from taskrpc.errors import TaskRpcError

Trigger = srvgen.load("std_srvs/srv/Trigger")


@pytest.fixture(autouse=True)
def _no_settings(monkeypatch):
    for name in ("ZENOH_SESSION_CONFIG_URI", "ZENOH_CONFIG_OVERRIDE", "ROS_DISTRO"):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def examine(capsys):
    """Runs the doctor: exit code, and the findings behind that of the domain."""

    def _examine(*argv):
        code = main(["doctor", *argv, "--json"])
        found = [tuple(each.values()) for each in json.loads(capsys.readouterr().out)]
        domain = next(n for n, (_, text, _) in enumerate(found) if text.startswith("domain "))
        return code, found[domain + 1 :]

    return _examine


def overridden(place):
    return f'connect/endpoints=["tcp/{place}"]'


@pytest.mark.real_time
def test_services_over_zenoh_are_reported_with_the_router(examine, zenoh_router):
    with taskrpc.sync.Node("server", transport="zenoh", peers=[zenoh_router]) as node:
        node.create_service(Trigger, "look", lambda request, response: response)
        code, found = examine("--transport", "zenoh", zenoh_router)
    assert code == 0
    assert [state for state, _, _ in found] == ["ok", "ok", "ok"]
    library, router, services = (text for _, text, _ in found)
    assert library.startswith("eclipse-zenoh 1.")
    assert router == f"programs over Zenoh connect to tcp/{zenoh_router}"
    assert services == "over Zenoh, programs in domain 0 offer /look"


@pytest.mark.real_time
def test_router_without_programs_is_a_note(examine, monkeypatch, zenoh_router):
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overridden(zenoh_router))
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    code, found = examine("--transport", "zenoh")
    assert code == 0
    assert found[-1][:2] == ("note", "no program offers a service over Zenoh in domain 7")
    assert found[-1][2] == "start one, for example taskrpc-server --transport zenoh"


@pytest.mark.real_time
def test_missing_router_of_the_environment_is_a_problem(examine, monkeypatch):
    pytest.importorskip("zenoh")
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", overridden("127.0.0.1:9"))
    code, found = examine()
    assert code == 1
    assert found[1][1] == "programs over Zenoh connect to tcp/127.0.0.1:9 (ZENOH_CONFIG_OVERRIDE)"
    state, text, advice = found[2]
    assert (state, text) == ("problem", "no Zenoh router answers at tcp/127.0.0.1:9")
    assert advice.startswith("start one there with `taskrpc router --listen 127.0.0.1:9`")


def zenoh_findings(remote=None):
    return [(each.state, each.text, each.advice) for each in middlewares._zenoh(remote or Remote())]


def test_missing_library_of_zenoh_is_a_problem_with_the_command_that_installs_it(monkeypatch):
    def missing(name):
        raise PackageNotFoundError(name)

    monkeypatch.setattr(middlewares, "version", missing)
    advice = install_command("zenoh", "eclipse-zenoh")
    assert zenoh_findings() == [("problem", "eclipse-zenoh is not installed", advice)]


@pytest.fixture
def installed(monkeypatch):
    monkeypatch.setattr(middlewares, "version", lambda name: "1.9.0")


def test_configuration_file_of_zenoh_is_named(installed, monkeypatch):
    monkeypatch.setenv("ZENOH_SESSION_CONFIG_URI", "/z.json5")
    text = "programs over Zenoh connect to the routers in /z.json5 (ZENOH_SESSION_CONFIG_URI)"
    assert zenoh_findings()[-1] == ("ok", text, "")


def test_invalid_override_is_a_problem(installed, monkeypatch):
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", "x")
    state, text, _ = zenoh_findings()[-1]
    assert state == "problem"
    assert text.startswith("ZENOH_CONFIG_OVERRIDE: expected key=value parts")


def test_peer_mode_is_noted(installed, monkeypatch):
    monkeypatch.setenv("ZENOH_CONFIG_OVERRIDE", 'mode="peer"')
    _, (state, text, advice), _ = zenoh_findings()
    assert state == "note"
    assert "gets nothing from a router" in text
    assert advice == 'use mode="client"'


def ros_findings(monkeypatch, rclpy):
    monkeypatch.setattr("taskrpc.middleware.ros.installed.real_rclpy", rclpy)
    return [(each.state, each.text, each.advice) for each in middlewares._ros(Remote())]


def test_missing_rclpy_is_a_problem(monkeypatch):
    def missing():
        raise TaskRpcError("there is no rclpy; source the setup file")

    expected = ("problem", "there is no rclpy", "source the setup file")
    assert ros_findings(monkeypatch, missing) == [expected]


def rclpy_with(identifier):
    utilities = SimpleNamespace(get_rmw_implementation_identifier=identifier)
    return lambda: SimpleNamespace(__file__="/opt/rclpy/__init__.py", utilities=utilities)


def test_rclpy_and_its_middleware_are_reported(monkeypatch):
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    rclpy = rclpy_with(lambda: "rmw_cyclonedds_cpp")
    assert ros_findings(monkeypatch, rclpy) == [
        ("ok", "RMW_IMPLEMENTATION is rmw_cyclonedds_cpp", ""),
        ("ok", "the real rclpy is /opt/rclpy/__init__.py", ""),
        ("ok", "ROS 2 uses rmw_cyclonedds_cpp", ""),
    ]


def test_middleware_that_is_not_installed_is_a_problem(monkeypatch):
    def missing():
        raise RuntimeError("librmw_x.so: no such file")

    state, text, advice = ros_findings(monkeypatch, rclpy_with(missing))[-1]
    assert (state, text) == (
        "problem",
        "ROS 2 cannot load its middleware: librmw_x.so: no such file",
    )
    assert "RMW_IMPLEMENTATION" in advice


def test_environment_says_which_middlewares_are_checked(monkeypatch):
    assert middlewares.transports_of(Remote()) == []
    assert middlewares.transports_of(Remote(transport="ros")) == ["ros"]
    monkeypatch.setenv("ZENOH_SESSION_CONFIG_URI", "/z.json5")
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    assert middlewares.transports_of(Remote()) == ["zenoh", "ros"]


def test_unknown_transport_is_refused(capsys):
    assert main(["doctor", "--transport", "zen"]) == 1
    assert "expected 'tcp', 'memory', 'ros' or 'zenoh', got 'zen'" in capsys.readouterr().err
