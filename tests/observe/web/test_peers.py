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


PATIENCE = 60
"""Seconds that a socket waits; longer is a failure."""
FAMILIES = [("127.0.0.1", socket.AF_INET)] + [("::1", socket.AF_INET6)] * has_ipv6()


def connected(listening, host):
    """Connect to a listening socket: both ends, and the caller's address at the other end."""
    listening.settimeout(PATIENCE)
    calling = socket.create_connection((host, listening.getsockname()[1]), timeout=PATIENCE)
    try:
        accepted, peer = listening.accept()
    except TimeoutError:
        pytest.fail(f"{calling} is connected, but {listening} got no connection in {PATIENCE} s")
    return calling, accepted, peer[:2]


def listener(host, family):
    return socket.create_server((host, 0), family=family)


@pytest.mark.parametrize(("host", "family"), FAMILIES)
def test_own_process_is_of_the_same_user(host, family):
    with listener(host, family) as listening:
        calling, accepted, peer = connected(listening, host)
        with calling, accepted:
            assert not is_other_user(peer, accepted.getsockname()[:2])


@linux
@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="this machine has no IPv6")
def test_ipv4_caller_of_a_socket_for_both_families_is_found():
    both = socket.create_server(("::", 0), family=socket.AF_INET6, dualstack_ipv6=True)
    with both as listening:
        calling, accepted, peer = connected(listening, "127.0.0.1")
        with calling, accepted:
            assert not is_other_user(peer, accepted.getsockname()[:2])


@linux
def test_connection_that_no_process_has_is_not_of_the_same_user():
    assert is_other_user(("127.0.0.1", 1), ("127.0.0.1", 2))


@linux
def test_socket_of_another_user_is_recognised(monkeypatch):
    with listener("127.0.0.1", socket.AF_INET) as listening:
        calling, accepted, peer = connected(listening, "127.0.0.1")
        with calling, accepted:
            real = os.getuid()
            monkeypatch.setattr(os, "getuid", lambda: real + 1)
            # root may always connect
            assert is_other_user(peer, accepted.getsockname()) is (real != 0)


@linux
@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can change")
def test_connection_of_another_user_is_recognised_also_when_it_is_closed():
    with listener("127.0.0.1", socket.AF_INET) as listening:
        os.seteuid(65534)
        try:
            calling, accepted, peer = connected(listening, "127.0.0.1")
        finally:
            os.seteuid(0)
        with calling, accepted:
            assert is_other_user(peer, accepted.getsockname())
            calling.close()  # its row now names root as the user
            assert is_other_user(peer, accepted.getsockname())


def test_other_machines_and_systems_without_tables_are_not_looked_up(monkeypatch):
    assert not is_other_user(("192.0.2.1", 1), ("192.0.2.2", 2))
    monkeypatch.setattr(peers.sys, "platform", "darwin")
    assert not is_other_user(("127.0.0.1", 1), ("127.0.0.1", 2))
