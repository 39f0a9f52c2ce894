"""`taskrpc join`: what it proposes next."""

from __future__ import annotations

from types import SimpleNamespace

import pytest

from taskrpc.cli import main
from taskrpc.cli.course import join
from taskrpc.core.security.lab import Lab


@pytest.mark.parametrize(
    ("services", "proposed"),
    [
        (["/robot_task", "/robot_task/list"], "taskrpc-call /robot_task task_type=move"),
        (["/arm/open", "/taskrpc_gateway/health"], "taskrpc service type NAME"),
    ],
)
def test_calls_of_tasks_are_proposed_only_if_the_lab_has_them(
    monkeypatch, capsys, services, proposed
):
    lab = Lab(address="192.168.1.20:7450", token="ada.secret", certificate="", namespace="/ada")
    listing = SimpleNamespace(services=[SimpleNamespace(name=each) for each in services])
    monkeypatch.setattr("taskrpc.course.classroom.invitation.from_join_string", lambda _: lab)
    monkeypatch.setattr("taskrpc.course.classroom.joining.find_lab", lambda found: found)
    monkeypatch.setattr(join, "_listing", lambda _: listing)
    monkeypatch.setattr(join, "_health", lambda _: [])
    monkeypatch.setattr(join, "remember_lab", lambda _: None)
    assert main.main(["join", "taskrpc-join1.x"]) == 0
    printed = capsys.readouterr().out
    assert proposed in printed
    assert ("/robot_task" in printed) == ("/robot_task" in services)
