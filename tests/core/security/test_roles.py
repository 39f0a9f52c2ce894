"""An account is usable or not at an instant, and its token names it."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from taskrpc import Account, Accounts, Role, TaskRpcError
from taskrpc.core.security.roles import account_of

SECRET = "a-secret-of-27-characters_x"
names = st.text("abcXYZ019_.@+-", min_size=1, max_size=64)
secrets = st.text("abcXYZ019_~=+/-", min_size=1, max_size=64)


@given(names, secrets)
def test_an_accounts_token_names_the_account(name, secret):
    account = Account(name, secret)
    assert account_of(account.token.encode()) == name
    assert account.token == f"{name}.{secret}"


@given(st.text("abcXYZ019_~=+/-", max_size=80))
def test_a_bare_secret_names_no_account(secret):
    assert account_of(secret.encode()) == ""


@pytest.mark.parametrize(
    "token", [b"", b".", b"a.", b".b", b"node 1.0", b"\xff\x00.a", b"a.b\n", b"a" * 65 + b".b"]
)
def test_invalid_token_names_no_account(token):
    assert account_of(token) == ""


def test_each_role_includes_the_smaller_ones():
    assert Role.OBSERVE < Role.SUBMIT < Role.OPERATE < Role.ADMIN
    assert Account("ana", SECRET).role is Role.SUBMIT


@pytest.mark.parametrize(
    ("account", "now", "why"),
    [
        (Account("ana", SECRET), 1e12, ""),
        (Account("ana", SECRET, expires=100.0), 99.9, ""),
        (Account("ana", SECRET, expires=100.0), 100.0, "the account ana has expired"),
        (Account("ana", SECRET, revoked=True), 0.0, "the account ana is revoked"),
    ],
)
def test_an_account_is_found_until_it_expires_or_is_revoked(account, now, why):
    accounts = Accounts([account])
    assert accounts.refusal("ana", now) == why
    assert accounts.find("ana", now) is (None if why else account)


def test_an_unknown_account_is_not_found():
    assert Accounts().find("eve", 0.0) is None
    assert Accounts().refusal("eve", 0.0) == "there is no account eve"


def test_the_recheck_an_account_is_its_present_value_or_why_it_ended():
    proved = Account("ana", SECRET)
    changed = replace(proved, role=Role.OPERATE)
    assert Accounts([proved]).recheck(proved, 0) == proved
    assert Accounts([changed]).recheck(proved, 0) == changed
    other, revoked = replace(proved, secret="another-one"), replace(proved, revoked=True)
    assert Accounts([other]).recheck(proved, 0) == "ana has another secret now"
    assert Accounts([revoked]).recheck(proved, 0) == "the account ana is revoked"
    assert Accounts().recheck(proved, 0) == "there is no account ana"


def test_two_accounts_of_one_name_are_refused():
    with pytest.raises(TaskRpcError, match=r"^the account ana is given twice$"):
        Accounts([Account("ana", SECRET), Account("ana", "another")])


@pytest.mark.parametrize("name", ["", "a b", "a\nb", "ä", "a/b", "n" * 65])
def test_a_name_that_a_token_cannot_have_is_refused(name):
    with pytest.raises(TaskRpcError, match="an account's name: expected 1 to 64 letters"):
        Account(name, SECRET)


@pytest.mark.parametrize("secret", ["", "with.dot", "with space", "ä", "s" * 257])
def test_invalid_secret_is_refused_without_being_shown(secret):
    with pytest.raises(TaskRpcError, match="the secret of the account ana: expected") as caught:
        Account("ana", secret)
    assert not secret or secret not in str(caught.value)


def test_a_secret_is_not_in_a_repr():
    account = Account("ana", SECRET)
    assert SECRET not in repr(account) + str(account) + repr([account])


@pytest.mark.parametrize("expires", [-1.0, float("nan"), float("inf"), -62135596800.0])
def test_invalid_expiry_is_refused(expires):
    with pytest.raises(TaskRpcError, match="the account ana: expires: expected an instant after"):
        Account("ana", SECRET, expires=expires)
