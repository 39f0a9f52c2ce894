"""Accounts without sockets: roles, revoked accounts, and request ids of two accounts."""

import pytest

import taskrpc
from taskrpc import Account, Accounts, Role
from taskrpc.core.request_ids.ids import StoredCompletions
from taskrpc.core.transport import endpoint
from tests.core.security.test_accounts import ANA, EYE, OTTO, call, write
from tests.core.transport.helpers import Add, Gate, add, ask, outcome, until


def in_memory(name, account=None, **options):
    token = None if account is None else account.token
    return taskrpc.Node(name, transport="memory", token=token, **options)


@pytest.fixture
def often(monkeypatch):
    """The server checks the file of accounts often."""
    monkeypatch.setattr(endpoint, "TICK", 0.02)


@pytest.fixture
def file(tmp_path):
    return write(tmp_path / "accounts.json", ANA, OTTO)


async def test_roles_hold_in_memory_as_they_do_on_sockets():
    seen = []

    def look(request, response):
        info = taskrpc.current_call()
        seen.append((info.principal, info.role))
        return response

    async with (
        in_memory("server", accounts=Accounts([ANA, EYE])) as server,
        in_memory("elsewhere", OTTO) as other,
        in_memory("laptop", ANA) as laptop,
        in_memory("looking", EYE) as looking,
        in_memory("guest", Account("guest", "guests-secret-of-29-character")) as guest,
        in_memory("local") as local,
    ):
        server.create_service(Add, "add", look)
        other.create_service(Add, "open", add)  # a server without accounts asks for none
        await call(laptop)
        await call(local)
        assert isinstance(await call(looking), taskrpc.PermissionDenied)
        assert isinstance(await call(guest), taskrpc.AuthenticationFailed)
        assert (await call(laptop, "/open")).sum == 5
    assert seen == [("ana", Role.SUBMIT), ("", Role.ADMIN)]


async def test_calls_and_output_of_a_revoked_account_end_at_once(file, often):
    """Running and waiting calls and unread output end at once, even if the peer does not close."""
    gate = Gate()
    async with (
        in_memory("server", accounts=file) as server,
        in_memory("laptop", ANA) as laptop,
    ):
        server.create_service(Add, "add", gate)
        client = laptop.create_client(Add, "/add", timeout=None)
        assert await client.wait_for_service(60)
        pipe = client._channel._connection.transport
        calls = [client.call_async(ask(number)) for number in range(5)]
        await until(lambda: gate.started == [0])
        (serving,) = server._transport._served
        pipe.pause_reading()  # and never closes
        serving.transport.write(bytes(100_000))
        write(file, OTTO)
        await until(lambda: gate.cancelled == [0])
        gate.opened.set()
        await until(lambda: not server._transport._served, 3)
        assert gate.started == [0]
        pipe.resume_reading()
        results = [await outcome(each) for each in calls]
        assert all(isinstance(each, taskrpc.TaskRpcError) for each in results)


async def test_same_request_id_of_two_accounts_names_two_requests():
    seen = []

    class Store:
        async def recall(self):
            return StoredCompletions(b"s" * 16)

        def complete(self, completion, effect, forgotten=()):
            seen.append(completion.principal)

    async with (
        in_memory("server", accounts=Accounts([ANA, OTTO])) as server,
        in_memory("ana", ANA) as ana,
        in_memory("otto", OTTO) as otto,
    ):
        server.create_service(Add, "add", add, exactly_once=Store())
        answers = []
        for node, number in ((ana, 1), (otto, 2), (ana, 1), (otto, 2)):
            client = node.create_client(Add, "/add", timeout=5)
            answers.append((await client.call(ask(number), request_id="mine")).sum)
    assert answers == [1, 2, 1, 2]
    assert seen == ["ana", "otto"]
