"""Every network has all members of the interface; addresses keep their secret."""

import inspect

import pytest

from taskrpc.core.transport.memory import MemoryNetwork
from taskrpc.core.transport.network import Address, Network, no_definition, no_server
from taskrpc.core.transport.tcp.tcp_network import TcpNetwork
from taskrpc.core.transport.tunnel.tunnel_network import TunnelNetwork
from taskrpc.errors import TypeMismatch

NETWORKS = [MemoryNetwork, TcpNetwork, TunnelNetwork]


@pytest.mark.parametrize("network", NETWORKS)
def test_a_network_has_every_method_of_the_interface(network):
    for name, method in inspect.getmembers(Network, inspect.isfunction):
        if not name.startswith("_"):
            there = inspect.signature(getattr(network, name)).parameters
            assert list(there) == list(inspect.signature(method).parameters), name
            is_async = inspect.iscoroutinefunction(method)
            assert inspect.iscoroutinefunction(getattr(network, name)) == is_async, name


def test_an_address_does_not_show_its_secret():
    assert repr(Address("robot:7450", b"the secret")) == "Address('robot:7450')"


async def test_the_error_without_a_server_gives_the_reason_if_there_is_one():
    network = MemoryNetwork(domain=0)
    assert str(no_server(network, "/add")) == "no server offers /add"
    network.problem = "the router is gone"
    assert str(no_server(network, "/add")) == "no server offers /add: the router is gone"


def test_the_error_without_a_definition_names_both_hashes_if_this_machine_has_another_one():
    error = no_definition("/add", "example_interfaces/srv/AddTwoInts", "RIHS01_0123456789abcdef")
    assert isinstance(error, TypeMismatch)
    assert str(error) == (
        "/add is offered as example_interfaces/srv/AddTwoInts with the hash RIHS01_01234567…, the"
        " definition on this machine has the hash RIHS01_e118de6b…; compare the two .srv files"
    )
    unknown = no_definition("/add", "no_such/srv/Type", "RIHS01_0123456789abcdef")
    assert "put the .srv file where taskrpc finds it" in str(unknown)
