"""A router of Zenoh for tests."""

import socket

import pytest


@pytest.fixture(scope="session")
def zenoh_router():
    """A router, and its address; all tests of this process share it."""
    session_module = pytest.importorskip("taskrpc.middleware.zenoh.session")
    from taskrpc.middleware.zenoh.configuration import router_configuration

    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    with session_module.open_session(router_configuration(place)):
        yield place
