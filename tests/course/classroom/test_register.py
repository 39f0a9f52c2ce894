"""The register of a class: its accounts may call, and each has a different secret."""

import datetime
import time
import unicodedata
from concurrent.futures import ThreadPoolExecutor

import pytest
from msgspec.structs import replace

from taskrpc.core import names
from taskrpc.core.security.roles import Role
from taskrpc.core.system import private_files
from taskrpc.course.classroom.authority import make_certificates
from taskrpc.course.classroom.class_server import ClassServer
from taskrpc.course.classroom.invitation import from_join_string
from taskrpc.course.classroom.register import Register
from taskrpc.course.classroom.student_names import namespace_of
from taskrpc.errors import TaskRpcError


@pytest.fixture
def register(tmp_path):
    return Register(tmp_path / "classroom")


def test_each_account_has_a_different_secret_and_may_submit(register):
    ada, bob = register.add(["ada", "bob"], 1e12)
    assert ada.secret != bob.secret
    assert {ada.role, bob.role} == {Role.SUBMIT}
    assert Register(register.folder).accounts() == [ada, bob]


def test_account_added_again_keeps_its_secret_and_gets_the_new_expiry(register):
    (before,) = register.add(["ada"], 1e12)
    (after,) = register.add(["ada"], 2e12)
    assert (after.secret, after.expires) == (before.secret, 2e12)


def test_revoked_account_is_refused_and_gets_a_new_secret_when_added_again(register):
    (before,) = register.add(["ada"], 0)
    register.revoke("ada")
    assert register.accounts()[0].refusal(time.time()) == "the account ada is revoked"
    (after,) = register.add(["ada"], 0)
    assert not after.revoked
    assert after.secret != before.secret


@pytest.mark.parametrize(
    ("there", "added", "namespace", "free"),
    [
        ([], ["ana.k", "ana_k"], "/ana_k", "ana.k2"),
        (["ana.k"], ["bo", "ana_k"], "/ana_k", "ana_k2"),
        (["7"], ["s_7"], "/s_7", "s_72"),
        (["ana@k", "ana_k2"], ["ana.k"], "/ana_k", "ana.k3"),
    ],
)
def test_two_accounts_never_share_a_namespace(register, there, added, namespace, free):
    before = register.add(there, 0)
    with pytest.raises(TaskRpcError) as caught:
        register.add(added, 0)
    told = str(caught.value)
    assert f"would share the namespace {namespace}: give one of them another name" in told
    assert told.endswith(f"such as {free}")
    assert register.accounts() == before


def test_namespace_of_a_revoked_account_is_free_until_it_is_added_again(register):
    register.add(["ana.k"], 0)
    register.revoke("ana.k")
    register.add(["ana_k"], 0)
    with pytest.raises(TaskRpcError, match=r"ana_k and ana\.k would share the namespace /ana_k"):
        register.add(["ana.k"], 0)


def test_no_join_string_gives_a_namespace_that_another_account_has(register):
    """As a file may have it that was edited by hand."""
    (ana,) = register.add(["ana"], 0)
    register.server = ClassServer(("192.0.2.7",), 7450)
    text = register.accounts_file.read_text()
    row = text[text.index("{", text.index('"ana"')) : text.index("}") + 1]
    register.accounts_file.write_text(f'{{"accounts": {{"ana.k": {row}, "ana_k": {row}}}}}')
    with pytest.raises(TaskRpcError, match="would share the namespace /ana_k"):
        register.join_string(replace(ana, name="ana_k"))


def test_edits_of_the_file_by_the_lecturer_are_kept(register):
    """An assistant who operates the robot is still one when the lines are printed again."""
    register.add(["ada", "bob"], 0)
    text = register.accounts_file.read_text()
    register.accounts_file.write_text(text.replace('"submit"', '"operate"', 1))
    ada, bob = register.add(["ada", "bob"], 1e12)
    assert (ada.role, bob.role) == (Role.OPERATE, Role.SUBMIT)
    register.revoke("ada")
    (ada,) = register.add(["ada"], 1e12)
    assert ada.role is Role.SUBMIT, "a revoked student who returns has the usual role"


@pytest.mark.parametrize(
    "text",
    [
        b"{",
        b'{"accounts": {"ada": {"secret": "x", "role": "root"}}}',
        b'{"accounts": {"ada": {"secret": "canary canary", "role": "submit"}}}',
        b'{"accounts": {"ada": {"secret": "x", "expires": -1}}}',
        b'{"accounts": {"a\xff": {}}}',
        b"[1]",
    ],
)
def test_damaged_file_is_reported_without_its_secrets(register, text):
    register.accounts_file.write_bytes(text)
    with pytest.raises(TaskRpcError) as caught:
        register.accounts()
    assert "account" in str(caught.value)
    assert "canary" not in str(caught.value)


def test_revoking_an_unknown_account_lists_the_known_ones(register):
    register.add(["ada", "bob"], 0)
    with pytest.raises(TaskRpcError, match="there is no account 'eve'; there are: ada, bob"):
        register.revoke("eve")


def test_invalid_name_adds_no_account(register):
    with pytest.raises(TaskRpcError, match="a student's name: expected 1 to 100 letters"):
        register.add(["ada", "b;b"], 0)
    assert register.accounts() == []


NAMES = ["ada", "José", "Jose", "محمد علي", "Ada Lovelace", "小明"]
ACCOUNTS = ["ada", "Jose", "Jose2", "student1", "Ada_Lovelace", "student2"]


def test_name_in_any_script_gets_an_account_and_is_stored_unchanged(register):
    added = register.add(NAMES, 0)
    assert [account.name for account in added] == ACCOUNTS
    written = Register(register.folder).names()
    assert [written.get(each, each) for each in ACCOUNTS] == NAMES
    namespaces = [namespace_of(account) for account in ACCOUNTS]
    assert len({*namespaces}) == len(NAMES)
    assert [names.check_namespace(each) for each in namespaces] == namespaces


def test_the_same_names_get_the_same_accounts_in_any_order(register):
    before = register.add(NAMES, 0)
    decomposed = [unicodedata.normalize("NFD", f"  {name} ") for name in reversed(NAMES)]
    assert register.add(decomposed, 0) == before
    assert len(register.accounts()) == len(NAMES)


def test_existing_account_is_not_given_to_a_similar_name(register):
    register.add(["Jose", "student1"], 0)
    added = register.add(["José", "小明"], 0)
    assert [account.name for account in added] == ["Jose2", "student2"]


def test_a_student_is_revoked_by_name_or_by_account(register):
    register.add(NAMES, 0)
    register.revoke("José")
    register.revoke("student1")
    revoked = [account.name for account in register.accounts() if account.revoked]
    assert revoked == ["Jose", "student1"]
    with pytest.raises(TaskRpcError, match="there are: ada, José, Jose, محمد علي"):
        register.revoke("eve")


def test_simultaneous_edits_lose_nothing(register):
    with ThreadPoolExecutor(8) as pool:
        list(pool.map(lambda number: register.add([f"s{number}"], 0), range(24)))
    assert {account.name for account in register.accounts()} == {f"s{n}" for n in range(24)}


def test_join_string_has_all_that_the_laptop_needs(register):
    make_certificates(register.folder, ["localhost"], datetime.datetime.now(datetime.UTC))
    register.server = ClassServer(("192.168.1.20", "fd00::1"), 7450, 3)
    (ada,) = register.add(["ada"], 1_800_000_000.7)
    found = from_join_string(register.join_string(ada))
    assert found.addresses == ("192.168.1.20:7450", "[fd00::1]:7450")
    assert found.fingerprint == register.certificates.fingerprint
    assert (found.token, found.namespace) == (ada.token, "/ada")
    assert (found.expires, found.domain) == (1_800_000_000, 3)


def test_missing_class_is_reported(register):
    with pytest.raises(TaskRpcError, match="there is no class yet: `taskrpc classroom` makes one"):
        register.server  # noqa: B018 - a property


def test_renewed_students_keep_their_names_and_get_new_secrets(register):
    before = register.add(["ada", "José", "bob"], 1e12)
    register.revoke("bob")
    after = register.renew(None, 2e12)
    assert [account.name for account in after] == ["ada", "Jose"]
    assert register.names() == {"Jose": "José"}
    assert not {each.secret for each in before} & {each.secret for each in after}
    assert register.accounts() == after


def test_students_of_the_next_group_replace_the_former_ones_but_not_the_assistant(register):
    (assistant, *_) = register.add(["assistant", "ada", "小明"], 1e12)
    text = register.accounts_file.read_text(encoding="utf-8")
    register.accounts_file.write_text(text.replace('"submit"', '"operate"', 1), encoding="utf-8")
    register.renew(["zoe", "小明"], 2e12)
    accounts = register.accounts()
    assert [account.name for account in accounts] == ["assistant", "zoe", "student1"]
    assert accounts[0] == replace(assistant, role=Role.OPERATE)


def test_wrong_name_for_the_next_group_costs_no_account(register):
    before = register.add(["ada", "José"], 1e12)
    with pytest.raises(TaskRpcError, match="share the namespace"):
        register.renew(["ana.k", "ana_k"], 1e12)
    assert register.accounts() == before
    assert register.names() == {"Jose": "José"}


def test_program_that_ends_while_accounts_are_renewed_leaves_all_or_none(register, monkeypatch):
    register.add(["ada", "José"], 1e12)
    write = private_files.write_private

    def write_and_end(path, content, **options):
        write(path, content, **options)
        if path == register.accounts_file:
            raise KeyboardInterrupt

    monkeypatch.setattr(private_files, "write_private", write_and_end)
    with pytest.raises(KeyboardInterrupt):
        register.renew(["zoe", "小明"], 2e12)
    assert [account.name for account in register.accounts()] == ["zoe", "student1"]


def test_robots_get_the_students_in_turn(register):
    names = ["ada", "bob", "cleo", "dina", "emil"]
    accounts = register.add(names, 4e9)
    make_certificates(register.folder, ["127.0.0.1"], datetime.datetime.now(datetime.UTC))
    register.server = ClassServer(("127.0.0.1",), 7450)
    assert {register.robot_of(name) for name in names} == {"/"}
    register.server = ClassServer(("127.0.0.1",), 7450, robots=2)
    found = [register.robot_of(name) for name in names]
    assert found == ["/", "/robot2", "/", "/robot2", "/"]
    strings = [from_join_string(register.join_string(account)) for account in accounts]
    assert [each.namespace for each in strings[:2]] == ["/ada", "/robot2/bob"]


def test_class_without_a_number_of_robots_has_one(register):
    assert register.robots == 1
    (register.folder / "server.json").write_text('{"hosts":["h"],"port":7450}', encoding="utf-8")
    assert register.robots == 1
