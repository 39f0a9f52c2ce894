"""A joined laptop calls the lab without configuration, and sends its secret to no other server."""

import asyncio
import datetime
import socket

import pytest

import taskrpc
from taskrpc.cli.shared.remote import HERE
from taskrpc.core.security import lab
from taskrpc.course.classroom.authority import fingerprint, make_certificates
from taskrpc.course.classroom.invitation import Invitation
from taskrpc.course.classroom.joining import find_lab, visit
from tests.core.transport.helpers import Add, add, ask, outcome
from tests.raw_servers import served

pytestmark = pytest.mark.real_time

TOKEN = "ada.0123456789abcdef"


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("lab")
    return make_certificates(folder, ["localhost"], datetime.datetime.now(datetime.UTC))


@pytest.fixture
async def server(made, monkeypatch, tmp_path):
    """A lab's server in domain 7; from then on, the test is on another machine in domain 0."""
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    tls = taskrpc.Tls(cert=made.cert, key=made.key)
    async with taskrpc.Node("server", tls=tls, token=TOKEN) as node:
        node.create_service(Add, "add", add)
        monkeypatch.delenv("ROS_DOMAIN_ID")
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        yield node


@pytest.fixture
def invitation(made, server):
    return Invitation((server.address,), made.fingerprint, TOKEN, "/ada", 0, 7)


def changed(invitation, **changes):
    fields = {name: getattr(invitation, name) for name in invitation.__struct_fields__}
    return Invitation(**{**fields, **changes})


async def found(invitation):
    return await asyncio.to_thread(find_lab, invitation)


async def call():
    async with taskrpc.Node("turtle") as node:
        client = node.create_client(Add, "add", timeout=5)
        return await outcome(client.call(ask(2, 3)))


async def test_every_later_program_reaches_the_lab(invitation):
    joined = await found(invitation)
    assert "/add" in [each.name for each in (await visit(joined)).services]
    lab.remember_lab(joined)
    assert (await call()).sum == 5
    lab.forget_lab()
    assert isinstance(await call(), taskrpc.ServiceUnavailable)


async def test_services_of_the_laptop_take_precedence(invitation):
    lab.remember_lab(await found(invitation))

    def other(request, response):
        response.sum = -1
        return response

    async with taskrpc.Node("here") as node:
        node.create_service(Add, "add", other)
        assert (await call()).sum == -1
    assert (await call()).sum == 5


@pytest.fixture
async def joined(invitation):
    lab.remember_lab(await found(invitation))


async def test_nodes_without_a_namespace_are_in_the_namespace_of_the_lab(joined, monkeypatch):
    assert taskrpc.Node("turtle").get_fully_qualified_name() == "/ada/turtle"
    assert taskrpc.sync.Node("turtle").get_fully_qualified_name() == "/ada/turtle"
    others = [
        taskrpc.Node("turtle", namespace="/"),
        taskrpc.Node("turtle", transport="memory"),
        taskrpc.Node("turtle", peers=["127.0.0.1:1"]),  # calls no lab
    ]
    assert {each.get_namespace() for each in others} == {"/"}
    assert taskrpc.Node("turtle", namespace="/lab7").get_namespace() == "/lab7"
    assert HERE.node().get_namespace() == "/"
    monkeypatch.setenv("TASKRPC_PEERS", "127.0.0.1:1")
    assert taskrpc.Node("turtle").get_namespace() == "/"
    monkeypatch.delenv("TASKRPC_PEERS")
    lab.forget_lab()
    assert taskrpc.Node("turtle").get_namespace() == "/"


async def test_services_go_into_the_namespace_unless_their_name_is_absolute(joined):
    async with taskrpc.Node("turtle") as node:
        for name in ("add", "/add", "~/add"):
            node.create_service(Add, name, add, join=True)
        (here,) = [entry for entry in await node.graph() if "/ada/turtle" in entry.nodes]
    assert [each.name for each in here.services] == ["/ada/add", "/add", "/ada/turtle/add"]


async def test_relative_name_means_the_students_service_then_the_service_of_the_lab(
    joined, invitation
):
    """So that programs which know of no lab, such as the lecture's, call it unchanged."""

    def other(request, response):
        response.sum = -1
        return response

    async with taskrpc.Node("turtle") as node:
        client = node.create_client(Add, "add", timeout=5)
        assert (await client.call(ask(2, 3))).sum == 5
        # A request id means the same one as to who calls it by its absolute name.
        assert client._channel.service_name == "/add"
        assert (await node.definition("add"))[0] == "example_interfaces/srv/AddTwoInts"
        async with taskrpc.Node("mine", token="m") as mine:
            mine.create_service(Add, "add", other)
            again = node.create_client(Add, "add", timeout=5)
            assert (await again.call(ask(2, 3))).sum == -1
            absolute = node.create_client(Add, "/add", timeout=5)
            assert (await absolute.call(ask(2, 3))).sum == 5
        nobody = await outcome(node.create_client(Add, "nothing").call(ask()))
        assert str(nobody) == "no server offers /ada/nothing or /nothing"
        private = await outcome(node.create_client(Add, "~/add").call(ask()))
        assert str(private) == "no server offers /ada/turtle/add"


async def test_given_namespace_takes_precedence(joined):
    async with taskrpc.Node("turtle", namespace="/own") as node:
        error = await outcome(node.create_client(Add, "add").call(ask()))
        assert str(error) == "no server offers /own/add"


async def test_peers_take_precedence_over_the_lab(invitation, monkeypatch):
    lab.remember_lab(await found(invitation))
    with socket.create_server(("127.0.0.1", 0)) as unused:
        port = unused.getsockname()[1]
    monkeypatch.setenv("TASKRPC_PEERS", f"127.0.0.1:{port}")
    assert isinstance(await call(), taskrpc.ServiceUnavailable)


async def test_address_of_the_lab_as_a_peer_uses_its_certificate_and_token(invitation, monkeypatch):
    lab.remember_lab(await found(invitation))
    monkeypatch.setenv("TASKRPC_PEERS", invitation.addresses[0])
    assert (await call()).sum == 5


async def test_first_address_that_answers_is_used(invitation):
    with socket.create_server(("127.0.0.1", 0)) as unused:
        silent = f"127.0.0.1:{unused.getsockname()[1]}"
    joined = await found(changed(invitation, addresses=(silent, *invitation.addresses)))
    assert joined.address == invitation.addresses[0]


async def test_a_server_with_another_certificate_is_refused(invitation, made):
    wrong = changed(invitation, fingerprint=bytes(32))
    with pytest.raises(
        taskrpc.AuthenticationFailed, match="shows another certificate than the join"
    ):
        await found(wrong)


async def test_an_impostor_at_the_labs_address_gets_no_request(invitation, tmp_path):
    joined = await found(invitation)
    other = make_certificates(tmp_path, ["localhost"], datetime.datetime.now(datetime.UTC))
    assert fingerprint(other.cert.read_text()) != invitation.fingerprint
    lab.remember_lab(taskrpc_lab(joined, other.cert.read_text()))
    assert isinstance(await call(), taskrpc.ServiceUnavailable)


def taskrpc_lab(joined, certificate):
    return lab.Lab(
        address=joined.address, token=TOKEN, certificate=certificate, domain=joined.domain
    )


async def test_refused_token_is_reported(invitation):
    joined = await found(changed(invitation, token="eve.0123456789abcdef"))
    with pytest.raises(taskrpc.AuthenticationFailed):
        await visit(joined)


async def test_expired_string_is_reported_without_a_connection(invitation):
    late = changed(invitation, expires=1_000_000_000, addresses=("192.0.2.1:1",))
    with pytest.raises(taskrpc.AuthenticationFailed, match="the join string expired at 2001-09-09"):
        await found(late)


def test_unreachable_lab_is_reported_with_the_remedy(made):
    with socket.create_server(("127.0.0.1", 0)) as unused:
        place = f"127.0.0.1:{unused.getsockname()[1]}"
    lost = Invitation((place,), made.fingerprint, TOKEN, "/ada", 0, 0)
    with pytest.raises(taskrpc.ServiceUnavailable, match=r"cannot be reached: .*refused") as caught:
        find_lab(lost)
    assert caught.value.__notes__ == [f"`taskrpc doctor {place}` finds out why"]


def test_another_program_at_the_address_is_reported(made):
    with served(socket.create_server(("127.0.0.1", 0)), _babble) as place:
        lost = Invitation((place,), made.fingerprint, TOKEN, "/ada", 0, 0)
        with pytest.raises(taskrpc.ServiceUnavailable, match="another program than a lab's server"):
            find_lab(lost)


def _babble(connection):
    connection.sendall(b"220 mail.example ESMTP\r\n")
    connection.recv(4096)
