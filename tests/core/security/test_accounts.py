"""A server with accounts: roles of callers, and changes of the file of accounts."""

import asyncio
import json
import logging
import os
import ssl

import pytest
from msgspec.structs import replace

import taskrpc
from taskrpc import Account, Accounts, Role
from taskrpc.core.security import accounts as accounts_module
from taskrpc.core.security.accounts import AccountSource, read_accounts
from taskrpc.core.security.tls import Tls
from taskrpc.core.transport import endpoint
from tests.core.transport.helpers import Add, Gate, Text, add, ask, outcome, until

pytestmark = pytest.mark.real_time

ANA = Account("ana", "anas-secret-of-27-characters", Role.SUBMIT)
OTTO = Account("otto", "ottos-secret-of-28-characters", Role.OPERATE)
EYE = Account("eye", "eyes-secret-of-27-characters", Role.OBSERVE)
posix = pytest.mark.skipif(os.name != "posix", reason="file modes are POSIX's")


def write(path, *accounts, mode=0o600):
    rows = {
        each.name: {
            "secret": each.secret,
            "role": each.role.name.lower(),
            "expires": each.expires,
            "revoked": each.revoked,
        }
        for each in accounts
    }
    fresh = path.with_suffix(".new")
    fresh.write_text(json.dumps({"accounts": rows}))
    fresh.chmod(mode)
    fresh.replace(path)
    return path


@pytest.fixture
def file(tmp_path):
    return write(tmp_path / "accounts.json", ANA, OTTO, EYE)


def caller(server, account, name="laptop", **options):
    return taskrpc.Node(name, peers=[server.address], token=account.token, **options)


async def call(node, name="/add"):
    return await outcome(node.create_client(Add, name, timeout=5).call(ask(2, 3)))


async def test_a_callback_knows_the_account_and_its_role():
    seen = []

    def look(request, response):
        info = taskrpc.current_call()
        seen.append((info.principal, info.role))
        return response

    async with taskrpc.Node("server", accounts=Accounts([ANA])) as server:
        server.create_service(Add, "add", look)
        async with caller(server, ANA) as laptop, taskrpc.Node("local") as local:
            await call(laptop)
            await call(local)
    assert seen == [("ana", Role.SUBMIT), ("", Role.ADMIN)]


@pytest.mark.parametrize("account", [EYE, ANA, OTTO])
@pytest.mark.parametrize("role", list(Role))
async def test_call_runs_only_with_a_sufficient_role(account, role):
    ran = []

    def count(request, response):
        ran.append(1)
        return response

    async with taskrpc.Node("server", accounts=Accounts([ANA, OTTO, EYE])) as server:
        server.create_service(Add, "add", count, role=role)
        async with caller(server, account) as laptop:
            answer = await call(laptop)
    assert len(ran) == (account.role >= role)
    if not ran:
        assert isinstance(answer, taskrpc.PermissionDenied)
        assert answer.not_executed is True
        assert str(answer) == (
            f"/add needs the role {role.name.lower()};"
            f" the account {account.name} has {account.role.name.lower()}"
        )


async def test_observer_role_sees_services_that_it_may_not_call():
    async with taskrpc.Node("server", accounts=Accounts([EYE])) as server:
        server.create_service(Add, "add", add, role=Role.ADMIN)
        async with caller(server, EYE) as laptop:
            type_name, text = await laptop.definition("/add")
    assert type_name == "example_interfaces/srv/AddTwoInts"
    assert "int64 a" in text


async def test_a_refused_call_is_not_repeated():
    policy = taskrpc.RetryPolicy(attempts=5, wait_initial=0.001)
    async with taskrpc.Node("server", accounts=Accounts([EYE])) as server:
        server.create_service(Add, "add", add, idempotent=True)
        async with caller(server, EYE) as laptop:
            client = laptop.create_client(Add, "/add", timeout=5, retry=policy)
            assert isinstance(await outcome(client.call(ask())), taskrpc.PermissionDenied)
            assert client.retries == 0


@pytest.mark.parametrize(
    "change",
    [
        [OTTO],
        [taskrpc.Account("ana", ANA.secret, revoked=True)],
        [taskrpc.Account("ana", ANA.secret, expires=1.0)],
        [taskrpc.Account("ana", "another-secret-for-ana")],
    ],
)
async def test_a_revoked_account_loses_its_connections_and_gets_none(file, monkeypatch, change):
    monkeypatch.setattr(endpoint, "TICK", 0.02)
    gate = Gate()
    async with taskrpc.Node("server", accounts=file) as server:
        server.create_service(Add, "add", gate, concurrency=9)
        async with caller(server, ANA) as laptop:
            client = laptop.create_client(Add, "/add", timeout=5)
            pending = asyncio.ensure_future(outcome(client.call(ask(1))))
            await until(lambda: gate.started)
            write(file, *change)
            lost = await pending
            assert isinstance(lost, taskrpc.ConnectionLost | taskrpc.AuthenticationFailed), lost
            assert not lost.not_executed
            await until(lambda: gate.cancelled == [1])
            refused = await outcome(client.call(ask(2)))
            assert isinstance(refused, taskrpc.AuthenticationFailed)
            assert str(refused).endswith("the token is not this server's")


async def test_connection_of_a_revoked_account_that_stays_open_is_aborted(
    file, authority, tmp_path, monkeypatch
):
    """Neither unread answers nor a missing farewell of TLS keep a connection alive."""
    monkeypatch.setattr(endpoint, "TICK", 0.02)
    path = tmp_path / "server.pem"
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
    gate = Gate()
    async with taskrpc.Node("server", accounts=file, tls=Tls(cert=path, key=path)) as server:
        server.create_service(Add, "add", gate)
        async with caller(server, ANA, tls=Tls()) as laptop:
            client = laptop.create_client(Add, "/add", timeout=None)
            assert await client.wait_for_service(60)
            pending = asyncio.ensure_future(outcome(client.call(ask(1))))
            await until(lambda: gate.started)
            (connection,) = laptop._transport.dialler.connections
            connection.transport.pause_reading()
            (serving,) = server._transport._served
            serving.transport.write(bytes(20_000_000))
            write(file, OTTO)
            await until(lambda: not server._transport._served, 4)
            assert gate.cancelled == [1]
            connection.abort(taskrpc.ConnectionLost("the test is over"))
            await pending


async def test_changed_role_counts_from_the_next_check_of_the_file(file, monkeypatch):
    monkeypatch.setattr(endpoint, "TICK", 0.02)
    async with taskrpc.Node("server", accounts=file) as server:
        server.create_service(Add, "add", add, role=Role.OPERATE)
        async with caller(server, ANA) as laptop:
            client = laptop.create_client(Add, "/add", timeout=5)
            assert isinstance(await outcome(client.call(ask())), taskrpc.PermissionDenied)
            write(file, Account("ana", ANA.secret, Role.OPERATE))
            await until(lambda: server.status().accepted.open == 0)
            assert (await client.call(ask(2, 3))).sum == 5


async def test_a_new_account_may_call_without_a_restart(file):
    new = Account("new", "news-secret-of-27-characters")
    async with taskrpc.Node("server", accounts=file) as server:
        server.create_service(Add, "add", add)
        async with caller(server, new) as laptop:
            assert isinstance(await call(laptop), taskrpc.AuthenticationFailed)
        write(file, ANA, new)
        await until(lambda: server.status().accepted.open == 0)
        async with caller(server, new) as laptop:
            for _ in range(100):
                answer = await call(laptop)
                if not isinstance(answer, taskrpc.AuthenticationFailed):
                    break
                await asyncio.sleep(0.02)  # the file is looked at once a second
            assert answer.sum == 5


async def test_a_broken_file_changes_nothing_but_the_log(file, caplog):
    source = AccountSource(file)
    before = source.current
    file.write_text("{")
    with caplog.at_level(logging.INFO, "taskrpc"):
        assert source.refresh() is False
        assert source.refresh() is False
    assert source.current is before
    (line,) = caplog.messages
    assert line.startswith("the accounts stay as they were: ")
    write(file, ANA)
    assert source.refresh() is True
    assert [each.name for each in source.current] == ["ana"]
    file.unlink()
    assert source.refresh() is False
    assert len(source.current) == 1


@posix
@pytest.mark.parametrize(
    ("change", "role"),
    [
        ([replace(ANA, revoked=True), OTTO], None),
        ([OTTO], None),
        ([replace(ANA, expires=1.0), OTTO], None),
        ([replace(ANA, secret="another-secret-for-ana"), OTTO], None),
        ([replace(ANA, role=Role.OBSERVE), OTTO], Role.OBSERVE),
        ([replace(ANA, role=Role.ADMIN), OTTO], Role.SUBMIT),
        ([ANA, OTTO, EYE], Role.SUBMIT),
    ],
)
def test_only_restrictions_of_a_readable_file_take_effect(tmp_path, change, role, caplog):
    """A revocation must hold although an editor has saved the file with another mode."""
    file = write(tmp_path / "accounts.json", ANA, OTTO)
    source = AccountSource(file)
    write(file, *change, mode=0o644)
    assert source.refresh() is True
    found = source.current.find("ana", 2.0)
    assert (None if found is None else (found.role, found.secret)) == (
        None if role is None else (role, ANA.secret)
    )
    assert source.current.find("otto", 2.0) == OTTO
    assert source.current.find("eye", 2.0) is None
    (line,) = caplog.messages
    assert line.startswith("only the restrictions in this file of accounts take effect: ")
    assert line.endswith(f"do `chmod 600 {file}`")
    file.chmod(0o600)
    assert source.refresh() is True
    assert {each.name for each in source.current} == {each.name for each in change}


@posix
def test_a_file_that_others_can_write_changes_nothing(file, caplog):
    source = AccountSource(file)
    before = source.current
    write(file, OTTO, mode=0o666)
    assert source.refresh() is False
    assert source.current is before
    (line,) = caplog.messages
    assert line.startswith("the accounts stay as they were: ")
    assert "mode is 0666" in line


def test_invalid_file_of_accounts_is_logged_again(file, caplog, monkeypatch):
    source = AccountSource(file)
    file.write_text("{")
    source.refresh()
    monkeypatch.setattr(accounts_module, "LOG_PERIOD", 0.0)
    source.refresh()
    first, second = caplog.messages
    assert first == second
    write(file, ANA)
    source.refresh()
    source.refresh()
    assert len([record for record in caplog.records if record.levelname == "ERROR"]) == 2


@posix
async def test_file_that_becomes_invalid_is_logged_without_connections(file, caplog, monkeypatch):
    monkeypatch.setattr(endpoint, "TICK", 0.02)
    async with taskrpc.Node("server", accounts=file) as server:
        server.create_service(Add, "add", add)
        file.chmod(0o644)
        await until(lambda: "its mode is 0644" in caplog.text)


def test_a_file_may_be_toml(tmp_path):
    path = tmp_path / "accounts.toml"
    path.write_text(
        '[accounts.ana]\nsecret = "anas-secret-of-27-characters"\nrole = "operate"\n'
        '[accounts."bo@lab.example"]\nsecret = "bos-secret-of-27-characters"\n'
        "expires = 2026-12-24T18:00:00Z\n"
    )
    path.chmod(0o600)
    ana, bo = read_accounts(path)
    assert (ana.role, ana.expires, bo.role) == (Role.OPERATE, 0.0, Role.SUBMIT)
    assert bo.name == "bo@lab.example"
    assert bo.expires == 1798135200.0


SECRET = "canary-canary-canary"
TOML = '[accounts.ana]\nsecret = "%s"\n'


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("{", ": expected accounts as JSON: it cannot be read"),
        (SECRET, ", line 1: expected accounts as JSON: it cannot be read"),
        ('{"accounts": []}', "expected only accounts, such as"),
        ('["%s"]', "; got a list"),
        ('{"accounts": {"a": {}}}', ", line 1: the account a: secret is missing"),
        ('{"acounts": {}}', "got 'acounts' beside them"),
        ('{"accounts": {"a": {"secret": "%s", "expires": "0001-01-01T00:00:00"}}}', "expires: "),
        (
            '{"accounts": {"a": {"secret": "%s", "expires": -1}}}',
            "the account a: expires: expected",
        ),
        (
            '{"accounts": {"a": {"secret": "%s", "expires": "0001-01-01T00:00:00Z"}}}',
            "the account a: expires: expected an instant after 1970",
        ),
        (
            '{"accounts": {\n"a": {"secret": "%s",\n"role": "root"}}}',
            ", line 3: the account a: role: expected observe, submit, operate or admin, got 'root'",
        ),
        ('{"accounts": {"a": {"secret": "short"}}}', "account a has 5 characters; expected at"),
        ('{"accounts": {"a b": {"secret": "%s"}}}', "an account's name: expected 1 to 64"),
        ('{"accounts": {"a": {"secret": "%s.x"}}}', "the secret of the account a: expected 1 to"),
        (
            '{"accounts": {"a": {"secret": ["%s"]}}}',
            "secret: expected a text in quotes, got a list",
        ),
        ('{"accounts": {"a": "%s"}}', "the account a: expected a table with secret, role, expires"),
    ],
)
def test_invalid_file_is_reported_without_secrets(tmp_path, text, sentence):
    path = tmp_path / "accounts.json"
    path.write_text(text.replace("%s", SECRET))
    path.chmod(0o600)
    with pytest.raises(taskrpc.TaskRpcError) as caught:
        read_accounts(path)
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert SECRET not in str(caught.value)


OTHER = '[accounts.role]\nsecret = "%s"\n# [accounts.ana] role = "boss"\n\n'


@pytest.mark.parametrize(
    ("rows", "sentence"),
    [
        (
            '[accounts."ana"]\nsecret = "%s"\n\nrole = "Operate"',
            ", line 8: the account ana: role: expected observe, submit, operate or admin,"
            " got 'Operate'",
        ),
        ("[ accounts . ana ]\nrole = 3", ", line 5: the account ana: secret is missing"),
        (
            '[accounts.ana]\nrol = "admin"\nsecret = "%s"',
            ", line 6: the account ana: expected secret, role, expires and revoked, got 'rol'",
        ),
        (
            '[accounts.ana]\nsecret = "%s"\nrevoked = "yes"',
            ", line 7: the account ana: revoked: expected true or false, got 'yes'",
        ),
        (
            '[accounts.ana]\nsecret = "%s"\nexpires = "soon"',
            ", line 7: the account ana: expires: expected seconds since 1970, or an instant such as"
            " 2026-12-24T18:00:00Z, got 'soon'",
        ),
        ("[accounts.ana]\nsecret = '%s'\nexpires = 2026-12-24", "18:00:00Z, got 2026-12-24"),
        (
            '[accounts]\nana = { secret = "%s", role = "boss" }',
            ": the account ana: role: expected observe, submit, operate or admin, got 'boss'",
        ),
        (
            '[accounts.ana]\nsecret = "%s\n',
            ", line 6: expected accounts as TOML, or JSON in a file",
        ),
        ('[ana]\nsecret = "%s"', "such as [accounts.ana]; got 'ana' beside them"),
        (
            '[accounts.ana]\nsecret = "short"',
            ", line 6: the secret of the account ana has 5 characters; expected at least 16",
        ),
    ],
)
def test_mistake_in_a_file_of_accounts_names_the_account_and_the_line(tmp_path, rows, sentence):
    path = tmp_path / "accounts.toml"
    head = OTHER if "[accounts]" not in rows else ""
    path.write_text((head + rows).replace("%s", SECRET))
    path.chmod(0o600)
    with pytest.raises(taskrpc.TaskRpcError) as caught:
        read_accounts(path)
    assert str(caught.value).startswith(str(path))
    assert sentence in str(caught.value)
    assert SECRET not in str(caught.value)


@posix
@pytest.mark.parametrize("mode", [0o644, 0o640, 0o602, 0o610])
def test_a_file_that_others_can_read_or_write_is_refused(file, mode):
    file.chmod(mode)
    with pytest.raises(taskrpc.TaskRpcError, match=r"only its owner can read.*chmod 600"):
        read_accounts(file)


def test_byte_order_mark_of_an_editor_is_ignored(tmp_path):
    for name, text in (("a.json", '{"accounts": {"ana": {"secret": "%s"}}}'), ("a.toml", TOML)):
        path = tmp_path / name
        path.write_text(text.replace("%s", SECRET), encoding="utf-8-sig")
        path.chmod(0o600)
        assert [each.name for each in read_accounts(path)] == ["ana"]


def test_a_missing_file_is_named(tmp_path):
    with pytest.raises(taskrpc.TaskRpcError, match=r"none\.json: No such file"):
        AccountSource(tmp_path / "none.json")


@pytest.fixture(scope="module")
def authority():
    import trustme

    return trustme.CA()


@pytest.mark.parametrize(
    ("name", "accounts", "expected"),
    [
        ("ana", None, ("", Role.ADMIN)),
        ("ana", [ANA], ("ana", Role.SUBMIT)),
        ("eve", [ANA], None),
    ],
)
async def test_certificate_proves_the_account_that_it_names(
    authority, tmp_path, monkeypatch, name, accounts, expected
):
    paths = {each: tmp_path / f"{each}.pem" for each in ("server", "caller", "ca")}
    authority.cert_pem.write_to_path(paths["ca"])
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(paths["server"])
    issued = authority.issue_cert("caller.example", common_name=name)
    issued.private_key_and_cert_chain_pem.write_to_path(paths["caller"])
    seen = []

    def look(request, response):
        info = taskrpc.current_call()
        seen.append((info.principal, info.role))
        return response

    tls = Tls(cert=paths["server"], key=paths["server"], ca=paths["ca"])
    known = None if accounts is None else Accounts(accounts)
    async with taskrpc.Node("server", tls=tls, accounts=known) as server:
        server.create_service(Add, "add", look)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        own = Tls(cert=paths["caller"], key=paths["caller"], ca=paths["ca"])
        async with taskrpc.Node("laptop", peers=[server.address], tls=own) as laptop:
            answer = await call(laptop)
    if expected is None:
        assert isinstance(answer, taskrpc.AuthenticationFailed)
        assert str(answer).endswith("the token is not this server's")
    assert seen == ([] if expected is None else [expected])


async def test_certificate_alone_is_not_enough_if_the_server_has_a_token(
    authority, tmp_path, monkeypatch
):
    both, ca = tmp_path / "both.pem", tmp_path / "ca.pem"
    authority.cert_pem.write_to_path(ca)
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(both)
    tls = Tls(cert=both, key=both, ca=ca)
    async with taskrpc.Node("server", tls=tls, token="t" * 16) as server:
        server.create_service(Add, "add", add)
        monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
        async with taskrpc.Node("laptop", peers=[server.address], tls=tls) as laptop:
            assert isinstance(await call(laptop), taskrpc.AuthenticationFailed)


async def test_a_changed_certificate_is_shown_to_new_connections(authority, tmp_path, caplog):
    path, ca = tmp_path / "server.pem", tmp_path / "ca.pem"
    authority.cert_pem.write_to_path(ca)
    path.touch(0o600)
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
    async with taskrpc.Node("server", tls=Tls(cert=path, key=path), token="t" * 16) as server:
        server.create_service(Add, "add", add)
        old = await shown(server)
        path.write_text("broken")
        with caplog.at_level(logging.ERROR, "taskrpc"):
            assert await shown(server) == await shown(server) == old
        (line,) = caplog.messages
        assert line.startswith("the certificate stays as it was: ")
        authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
        assert await shown(server) not in (old, None)


async def test_registry_gets_a_changed_certificate(authority, tmp_path, monkeypatch):
    monkeypatch.setattr(endpoint, "TICK", 0.02)
    path = tmp_path / "server.pem"
    authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
    async with (
        taskrpc.Node("server", tls=Tls(cert=path, key=path), token="t" * 16) as server,
        taskrpc.Node("first") as first,
    ):
        server.create_service(Add, "add", add)
        assert (await call(first)).sum == 5
        before = (await first.graph())[0].certificate
        authority.issue_cert("127.0.0.1").private_key_and_cert_chain_pem.write_to_path(path)
        await shown(server)
        entries = server._transport.network._registry.entries
        await until(lambda: entries()[0].certificate != before)
        async with taskrpc.Node("second", peers=[server.address]) as second:
            assert (await call(second)).sum == 5


async def shown(server):
    """The certificate that a server shows to who connects now."""
    context = ssl.create_default_context()
    context.check_hostname = False
    context.verify_mode = ssl.CERT_NONE
    host, _, port = server.address.rpartition(":")
    _, writer = await asyncio.open_connection(host, int(port), ssl=context)
    certificate = writer.get_extra_info("ssl_object").getpeercert(binary_form=True)
    writer.close()
    return certificate


def test_file_with_an_oversized_number_is_refused(tmp_path):
    path = tmp_path / "accounts.toml"
    path.write_text(f"[accounts.ana]\nexpires = {'1' * 5000}\n")
    path.chmod(0o600)
    with pytest.raises(taskrpc.TaskRpcError, match="expected accounts as TOML, or JSON in"):
        read_accounts(path)


async def test_service_that_an_account_looked_for_in_vain_is_known_until_it_finds_one(file):
    async with taskrpc.Node("server", listen="127.0.0.1:0", accounts=file) as server:
        server.create_service(Add, "/add", add)
        async with caller(server, ANA) as laptop:
            for name, srv_type, found in (
                ("/ad", Add, {"ana": ("/ad", False)}),
                ("/add", Text, {"ana": ("/add", True)}),
            ):
                client = laptop.create_client(srv_type, name, timeout=0.5)
                with pytest.raises(taskrpc.TaskRpcError):
                    await client.call(srv_type.Request())
                assert server.status().accepted.failed_lookups == found
            await call(laptop)
            assert server.status().accepted.failed_lookups == {}
