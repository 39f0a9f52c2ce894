"""Each token allows what it is for, and nothing else."""

import hmac
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.security.accounts import AccountSource
from taskrpc.core.security.roles import Role
from taskrpc.observe.web.tokens import Holder, Tokens

SECRET = "s" * 20
ACCOUNTS = f"""
[accounts.ana]
secret = "{SECRET}"
role = "observe"
[accounts.bo]
secret = "{SECRET}"
revoked = true
[accounts.cy]
secret = "{SECRET}"
expires = {time.time() - 1}
"""


@pytest.fixture
def tokens(tmp_path):
    path = tmp_path / "accounts.toml"
    path.write_text(ACCOUNTS, encoding="utf-8")
    path.chmod(0o600)
    return Tokens("the server's own", AccountSource(str(path)))


def test_tokens_of_links_are_random_and_long():
    made = Tokens(), Tokens()
    found = {each for tokens in made for each in (tokens.view, tokens.control)}
    assert len(found) == 4
    assert all(len(each) >= 43 for each in found)


def test_token_for_control_stands_for_the_user_of_the_server(tokens):
    assert tokens.holder(tokens.control) == Holder("")
    assert tokens.holder("the server's own") == Holder("")


def test_token_of_an_account_stands_for_the_account(tokens):
    token = f"ana.{SECRET}"
    assert tokens.holder(token) == Holder("ana", token, Role.OBSERVE)


def test_account_with_the_role_observe_may_not_control():
    assert not Holder("ana", "", Role.OBSERVE).may_control
    assert Holder("ana", "", Role.SUBMIT).may_control
    assert Holder("").may_control


def test_read_only_token_does_not_allow_control(tokens):
    assert tokens.may_look(tokens.view)
    assert tokens.holder(tokens.view) is None


@pytest.mark.parametrize(
    "token", ["", f"bo.{SECRET}", f"cy.{SECRET}", f"nobody.{SECRET}", f"ana.{SECRET}x", "ana."]
)
def test_other_tokens_allow_nothing(tokens, token):
    assert tokens.holder(token) is None
    assert not tokens.may_look(token)


@given(st.text())
def test_any_other_text_allows_nothing(text):
    assert not Tokens().may_look(text)
    assert not Tokens("server").may_look("" if text == "server" else text)


def test_tokens_of_links_are_not_valid_for_processes_of_other_users(tokens):
    for link in (tokens.view, tokens.control):
        assert not tokens.may_look(link, of_links=False)
        assert tokens.holder(link, of_links=False) is None
    assert tokens.holder("the server's own", of_links=False) == Holder("")
    assert tokens.holder(f"ana.{SECRET}", of_links=False) is not None


def test_wrong_token_takes_the_same_comparisons_for_every_account(tokens, monkeypatch):
    compared = []
    compare = hmac.compare_digest
    monkeypatch.setattr(hmac, "compare_digest", lambda *two: compared.append(two) or compare(*two))
    counts = set()
    for name in ("ana", "bo", "nobody"):
        compared.clear()
        assert tokens.holder(f"{name}.{'x' * 20}") is None
        counts.add(len(compared))
    assert counts == {3}
