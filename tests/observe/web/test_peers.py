"""On Linux, the kernel's tables show the user at the other end of a connection of this machine."""

import os
import socket
import sys

import pytest

from taskrpc.observe.web import peers
from taskrpc.observe.web.peers import (
    caller_users,
    is_other_user,
    is_page_of_other_user,
    listener_users,
)

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
    assert not is_page_of_other_user(("192.0.2.1", 1), 1)
    monkeypatch.setattr(peers.sys, "platform", "darwin")
    assert not is_other_user(("127.0.0.1", 1), ("127.0.0.1", 2))
    assert not is_page_of_other_user(("127.0.0.1", 1), 1)


IPV4 = """\
  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid  timeout inode
   0: 0100007F:0BB8 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1000        0 31 1 0
   1: 00000000:0BB9 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1001        0 32 1 0
   2: 0A00000A:0BBA 00000000:0000 0A 00000000:00000000 00:00000000 00000000  1002        0 33 1 0
   3: 0100007F:0BBB 00000000:0000 07 00000000:00000000 00:00000000 00000000  1003        0 34 1 0
   4: 0100007F:0BB8 0100007F:C350 01 00000000:00000000 00:00000000 00000000  1000        0 35 1 0
   5: 0100007F:C350 0100007F:0BB8 01 00000000:00000000 00:00000000 00000000  1004        0 36 1 0
   6: 0100007F:C351 0100007F:0BB8 06 00000000:00000000 03:00000176 00000000     0        0 0 3 0
"""
IPV6 = """\
  sl  local_address                         remote_address                        st x
   0: 00000000000000000000000001000000:0BB8 00000000000000000000000000000000:0000 0A x x x 1005 0 41
   1: 00000000000000000000000000000000:0BB9 00000000000000000000000000000000:0000 0A x x x 1006 0 42
   2: 0000000000000000FFFF00000100007F:0BBA 00000000000000000000000000000000:0000 0A x x x 1007 0 43
   3: B80D0120000000000000000001000000:0BBB 00000000000000000000000000000000:0000 0A x x x 1008 0 44
   4: 0000000000000000FFFF00000100007F:C350 0000000000000000FFFF00000100007F:0BBB 01 x x x 1009 0 45
"""
little_endian = pytest.mark.skipif(sys.byteorder == "big", reason="the addresses are reversed")


@little_endian
@pytest.mark.parametrize(
    ("port", "by_ipv4", "by_ipv6"),
    [
        (3000, {1000}, {1005}),
        (3001, {1001}, {1006}),
        (3002, set(), {1007}),  # 10.0.0.10 is not localhost
        (3003, set(), set()),  # a socket that does not listen, and an address of the network
        (50000, set(), set()),
    ],
)
def test_listeners_of_a_port_of_localhost_are_found(port, by_ipv4, by_ipv6):
    assert (listener_users(IPV4, port), listener_users(IPV6, port)) == (by_ipv4, by_ipv6)


@little_endian
def test_caller_of_a_connection_is_found():
    caller, server = ("127.0.0.1", 50000), ("127.0.0.1", 3000)
    assert caller_users(IPV4, caller, server) == {1004}
    assert caller_users(IPV4, server, caller) == {1000}
    assert caller_users(IPV4, ("127.0.0.1", 50001), server) == set()  # no process has it
    assert caller_users(IPV6, caller, ("::ffff:127.0.0.1", 3003)) == {1009}


BROWSER = ("127.0.0.1", 50000)


@linux
@little_endian
@pytest.mark.parametrize(
    ("users", "expected"),
    [
        ([1000], False),
        ([0], False),
        ([1000, 0], False),
        ([1001], True),
        ([1000, 1001], True),
        ([], True),
    ],
)
def test_only_listeners_of_this_user_and_of_root_serve_its_pages(
    users, expected, monkeypatch, tmp_path
):
    row = IPV4.splitlines()[1]
    table = tmp_path / "tcp"
    rows = [row.replace("  1000  ", f"  {user}  ") for user in users]
    table.write_text("\n".join([IPV4.splitlines()[0], *rows]))
    monkeypatch.setattr(peers, "_SOCKET_TABLES", (table, tmp_path / "tcp6"))
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    assert is_page_of_other_user(BROWSER, 3000) is expected


@linux
@pytest.mark.parametrize(("host", "family"), FAMILIES)
def test_page_that_this_process_serves_is_of_the_same_user_until_the_server_ends(host, family):
    with listener(host, family) as listening:
        port = listening.getsockname()[1]
        assert not is_page_of_other_user(BROWSER, port)
    assert is_page_of_other_user(BROWSER, port)


@linux
@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="only root can change")
def test_page_that_another_user_serves_is_recognised():
    os.seteuid(65534)
    try:
        listening = listener("127.0.0.1", socket.AF_INET)
    finally:
        os.seteuid(0)
    with listening:
        assert is_page_of_other_user(BROWSER, listening.getsockname()[1])
