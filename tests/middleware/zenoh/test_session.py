"""Opening a session, and its errors."""

from __future__ import annotations

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.middleware.zenoh.configuration import (
    Configuration,
    configuration_of,
    router_configuration,
)
from taskrpc.middleware.zenoh.session import open_session, reason_of


@pytest.mark.real_time
def test_a_missing_router_is_named_with_what_to_do():
    with pytest.raises(TaskRpcError) as caught:
        open_session(configuration_of(["127.0.0.1:9"]))
    assert str(caught.value) == (
        "no Zenoh router answers at tcp/127.0.0.1:9; start one there with `taskrpc router --listen"
        " 127.0.0.1:9`, or give the address of another router with --connect, peers= or"
        " TASKRPC_PEERS"
    )


@pytest.mark.real_time
def test_a_missing_router_of_the_environment_is_named_with_the_variable():
    override = {"ZENOH_CONFIG_OVERRIDE": 'connect/endpoints=["tcp/127.0.0.1:9"]'}
    with pytest.raises(TaskRpcError) as caught:
        open_session(configuration_of([], environ=override))
    assert str(caught.value) == (
        "no Zenoh router answers at tcp/127.0.0.1:9; start one there with `taskrpc router --listen"
        " 127.0.0.1:9`, or correct ZENOH_CONFIG_OVERRIDE"
    )


@pytest.mark.real_time
def test_a_missing_router_of_a_file_is_named_with_the_file(tmp_path):
    file = tmp_path / "zenoh.json5"
    file.write_text("{mode: 'client', connect: {endpoints: ['tcp/127.0.0.1:9']}}")
    with pytest.raises(TaskRpcError) as caught:
        open_session(configuration_of([], environ={"ZENOH_SESSION_CONFIG_URI": str(file)}))
    assert str(caught.value).startswith(
        f"no Zenoh router answers at the addresses in {file} (ZENOH_SESSION_CONFIG_URI); start one"
    )
    assert "tcp/127.0.0.1:9" in str(caught.value)


@pytest.mark.real_time
def test_a_taken_address_is_one_line(zenoh_router):
    with pytest.raises(TaskRpcError, match=r"cannot open a Zenoh session: .*in use") as caught:
        open_session(router_configuration(zenoh_router))
    assert ".rs:" not in str(caught.value)


@pytest.mark.parametrize(
    ("configuration", "problem"),
    [
        (Configuration("", (("mood", '"client"'),), ()), "Zenoh refuses mood="),
        (Configuration("", (("mode", "client"),), ()), "Zenoh refuses mode=client"),
        (Configuration("/nowhere.json5", (), ()), "cannot read Zenoh's configuration /nowhere"),
    ],
)
def test_an_invalid_configuration_is_refused(configuration, problem):
    with pytest.raises(TaskRpcError, match=problem):
        open_session(configuration)


def test_a_reason_is_one_line_without_places_in_the_source():
    error = ValueError("no\nway  at /build/zenoh/x.rs:12. Then " + "x" * 400)
    reason = reason_of(error)
    assert reason.startswith("no way Then x")
    assert len(reason) == 301
