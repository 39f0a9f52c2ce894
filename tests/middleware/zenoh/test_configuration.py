"""The configuration of a session follows the arguments and rmw_zenoh's variables."""

from __future__ import annotations

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.middleware.zenoh import configuration
from taskrpc.middleware.zenoh.configuration import (
    configuration_of,
    is_loopback,
    locator,
    router_configuration,
    start_command,
)


def test_by_default_a_session_is_a_client_of_the_router_of_this_machine():
    found = configuration_of([])
    values = dict(found.values)
    assert values["mode"] == '"client"'
    assert values["connect/endpoints"] == '["tcp/localhost:7447"]'
    assert found.routers == ("tcp/localhost:7447",)
    assert found.file == ""


def test_peers_are_the_routers():
    values = dict(configuration_of(["robot", "other:7000"]).values)
    assert values["connect/endpoints"] == '["tcp/robot:7447", "tcp/other:7000"]'


def test_a_file_replaces_the_defaults_and_the_overrides_come_last():
    environ = {
        "ZENOH_SESSION_CONFIG_URI": "file:///etc/zenoh.json5",
        "ZENOH_CONFIG_OVERRIDE": 'mode="peer"; connect/endpoints=["tcp/a:1"]',
    }
    found = configuration_of([], environ=environ)
    assert found.file == "/etc/zenoh.json5"
    assert found.values == (("mode", '"peer"'), ("connect/endpoints", '["tcp/a:1"]'))


@pytest.mark.parametrize(
    ("value", "routers"),
    [
        ('["tcp/a:1", "tls/[::1]:2"]', ("tcp/a:1", "tls/[::1]:2")),
        ("['tcp/a:1']", ("tcp/a:1",)),
        ('{"client": ["tcp/a:1"]}', ("tcp/a:1",)),
        ("7", ("7",)),
    ],
)
def test_errors_name_the_routers_of_an_override_as_addresses(value, routers):
    override = {"ZENOH_CONFIG_OVERRIDE": f"connect/endpoints={value}"}
    found = configuration_of(["robot"], environ=override)
    assert (found.routers, found.routers_from) == (routers, "ZENOH_CONFIG_OVERRIDE")


def test_errors_name_the_file_that_names_the_routers():
    found = configuration_of([], environ={"ZENOH_SESSION_CONFIG_URI": "/z.json5"})
    assert (found.routers, found.routers_from) == ((), "ZENOH_SESSION_CONFIG_URI")


@pytest.mark.parametrize(
    ("router", "command"),
    [
        ("tcp/localhost:7447", "taskrpc router"),
        ("tcp/127.0.0.1:7000", "taskrpc router --listen 127.0.0.1:7000"),
        ("tcp/localhost:7000", "taskrpc router --listen 127.0.0.1:7000"),
        ("tcp/robot:7447", "taskrpc router --listen 0.0.0.0:7447"),
        ("tls/robot:7447", "taskrpc router --listen tls/robot:7447"),
    ],
)
def test_the_command_that_starts_a_missing_router(router, command):
    assert start_command(router) == command


@pytest.mark.parametrize("text", ["mode", "=1", "mode=", 'mode="client";x'])
def test_an_invalid_override_is_refused(text):
    with pytest.raises(TaskRpcError, match="ZENOH_CONFIG_OVERRIDE: expected key=value"):
        configuration.overrides(text)


def test_empty_overrides_are_ignored():
    assert configuration.overrides("") == configuration.overrides(" ; ;") == []


@pytest.mark.parametrize(
    ("place", "found"),
    [
        ("robot", "tcp/robot:7447"),
        ("robot:7448", "tcp/robot:7448"),
        ("[::1]:7448", "tcp/[::1]:7448"),
        ("[fe80::1%eth0]", "tcp/[fe80::1%eth0]:7447"),
        ("tls/robot:7447", "tls/robot:7447"),
        ("unixsock-stream//run/zenoh", "unixsock-stream//run/zenoh"),
    ],
)
def test_addresses_of_routers(place, found):
    assert locator(place) == found


@pytest.mark.parametrize("place", ["", "a b", "unix:/run/x", "robot:port", "http://robot"])
def test_an_invalid_address_is_refused(place):
    with pytest.raises(TaskRpcError, match="expected HOST:PORT or tcp/HOST:PORT, got"):
        locator(place)


def test_a_router_listens_at_its_address_and_does_not_wait_for_others():
    values = dict(router_configuration("0.0.0.0:7447").values)
    assert values["mode"] == '"router"'
    assert values["listen/endpoints"] == '["tcp/0.0.0.0:7447"]'


@pytest.mark.parametrize(
    ("place", "loopback"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tcp/localhost:7447", True),
        ("tcp/[::1]:7447", True),
        ("tcp/0.0.0.0:7447", False),
        ("tcp/[::]:7447", False),
        ("tls/robot:7447", False),
        ("tcp/127.robot.example:7447", False),
    ],
)
def test_a_router_beyond_this_machine_is_recognised(place, loopback):
    assert is_loopback(place) is loopback
