"""This machine's addresses: what laptops can reach, and what a certificate can name."""

import socket

import pytest

from taskrpc.course.classroom import own_addresses


@pytest.mark.parametrize(
    ("text", "is_host"),
    [
        ("robot.lab", True),
        ("192.0.2.7", True),
        ("fd00::1", True),
        ("robot.lab:7450", False),
        ("-robot", False),
        ("", False),
    ],
)
def test_host_is_a_name_or_an_address_without_a_port(text, is_host):
    assert own_addresses.is_host(text) is is_host


def test_addresses_that_only_this_machine_reaches_are_left_out(monkeypatch):
    found = ["127.0.1.1", "169.254.3.4", "192.0.2.7", "192.0.2.7"]
    monkeypatch.setattr(socket, "gethostbyname_ex", lambda name: (name, [], found))
    monkeypatch.setattr(own_addresses, "_ELSEWHERE", ())
    assert own_addresses.own_addresses() == ["192.0.2.7"]


def test_host_name_that_no_certificate_can_contain_is_left_out(monkeypatch):
    monkeypatch.setattr(socket, "gethostname", lambda: "robot_of_the_lab")
    assert own_addresses.own_names() == ["localhost", "127.0.0.1", "::1"]
