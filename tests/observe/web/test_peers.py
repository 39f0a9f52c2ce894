"""On Linux, the kernel's tables show the user at the other end of a connection of this machine."""

import os
import socket
import sys

import pytest

from taskrpc.observe.web import peers
from taskrpc.observe.web.peers import is_other_user

pytestmark = pytest.mark.real_time
linux = pytest.mark.skipif(sys.platform != "linux", reason="only Linux has these tables")


def has_ipv6():
    """Whether this machine has an IPv6 loopback address; containers often have none."""
    try:
        socket.create_server(("::1", 0), family=socket.AF_INET6).close()
    except OSError:
        return False
    return True


FAMILIES = [("127.0.0.1", socket.AF_INET)] + [("::1", socket.AF_INET6)] * has_ipv6()


def connected(host, family, to=None):
    listening = socket.socket(family)
    listening.bind((host, 0))
    listening.listen()
    calling = socket.create_connection((to or host, listening.getsockname()[1]))
    accepted, peer = listening.accept()
    return listening, calling, accepted, peer[:2]


@pytest.mark.parametrize(("host", "family"), FAMILIES)
def test_own_process_is_of_the_same_user(host, family):
    *sockets, peer = connected(host, family)
    assert not is_other_user(peer, sockets[2].getsockname()[:2])
    for each in sockets:
        each.close()


@linux
@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this machine has no IPv6")
def test_ipv4_caller_of_a_socket_for_both_families_is_found():
    listening = socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True)
    calling = socket.create_connection(("127.0.0.1", listening.getsockname()[1]))
    accepted, peer = listening.accept()
    assert not is_other_user(peer[:2], accepted.getsockname()[:2])
    for each in (listening, calling, accepted):
        each.close()


@linux
def test_connection_that_no_process_has_is_not_of_the_same_user():
    assert is_other_user(("127.0.0.1", 1), ("127.0.0.1", 2))


@linux
def test_socket_of_another_user_is_recognised(monkeypatch):
    *sockets, peer = connected("127.0.0.1", socket.AF_INET)
    local = sockets[2].getsockname()
    real = os.getuid()
    monkeypatch.setattr(os, "getuid", lambda: real + 1)
    assert is_other_user(peer, local) is (real != 0)  # root may always connect
    for each in sockets:
        each.close()


@linux
@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can change")
def test_connection_of_another_user_is_recognised_also_when_it_is_closed():
    listening = socket.create_server(("127.0.0.1", 0))
    os.seteuid(65534)
    calling = socket.create_connection(listening.getsockname())
    os.seteuid(0)
    accepted, peer = listening.accept()
    assert is_other_user(peer, accepted.getsockname())
    calling.close()  # its row now names root as the user
    assert is_other_user(peer, accepted.getsockname())
    accepted.close()
    listening.close()


def test_other_machines_and_systems_without_tables_are_not_looked_up(monkeypatch):
    assert not is_other_user(("192.0.2.1", 1), ("192.0.2.2", 2))
    monkeypatch.setattr(peers.sys, "platform", "darwin")
    assert not is_other_user(("127.0.0.1", 1), ("127.0.0.1", 2))
