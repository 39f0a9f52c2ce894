"""A request is answered if it names this server, only reads, and has a valid token."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.core.security.accounts import AccountSource
from taskrpc.observe.web.guard import Access, Guard, Head, local_port, own_names
from taskrpc.observe.web.tokens import Tokens

HERE = own_names("127.0.0.1", 8080, machine="robot")


def status(head, **options):
    refusal = Guard(HERE, **options).refusal(head)
    return refusal.status if refusal else 200


def asked(host="127.0.0.1:8080", method="GET", **more):
    return Head(method, [host], **more)


@pytest.mark.parametrize("host", [*HERE, "LOCALHOST:8080", "[::1]:8080"])
@pytest.mark.parametrize("method", ["GET", "HEAD"])
def test_request_for_a_name_of_this_machine_is_accepted(host, method):
    assert status(asked(host, method)) == 200


@pytest.mark.parametrize(
    "host",
    [
        "evil.example:8080",
        "evil.example",
        "localhost",
        "localhost:80",
        "localhost:8080.evil.example",
        "localhost:8080@evil.example",
        "127.0.0.1:8081",
        "127.0.0.1.evil.example:8080",
        "robot:8080",
        "",
    ],
)
def test_request_for_a_foreign_host_name_is_refused(host):
    assert status(asked(host)) == 421


@given(st.text())
def test_any_other_host_is_refused(host):
    assert (status(asked(host)) == 200) == (host.lower() in HERE)


@pytest.mark.parametrize("hosts", [[], ["127.0.0.1:8080", "127.0.0.1:8080"]])
def test_request_without_exactly_one_host_is_refused(hosts):
    assert status(Head("GET", hosts)) == 400


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "CONNECT", "get"])
def test_methods_other_than_get_and_head_are_refused(method):
    assert status(asked(method=method)) == 405


@pytest.mark.parametrize(
    ("origin", "expected"),
    [
        ("http://127.0.0.1:8080", 200),
        ("http://localhost:8080", 403),  # another origin than the one that was asked
        ("https://127.0.0.1:8080", 403),
        ("http://evil.example", 403),
        ("null", 403),
        ("", 403),
    ],
)
def test_request_from_a_page_of_another_server_is_refused(origin, expected):
    assert status(asked(origins=[origin])) == expected


@pytest.mark.parametrize("site", ["cross-site", "same-site"])
def test_image_or_link_of_another_page_gets_nothing_that_the_page_shows(site):
    """A page at another port of this machine is same-site; images have no Origin header."""
    for access, expected in ((Access.LOOK, 403), (Access.LOAD, 200), (Access.MONITOR, 200)):
        assert granted(access, sites=[site]) == expected
    assert granted(Access.LOOK, sites=["same-origin", site]) == 403


@pytest.mark.parametrize("sites", [[], ["same-origin"], ["none"]])
def test_page_itself_typed_address_and_other_programs_see_what_the_page_shows(sites):
    assert granted(Access.LOOK, sites=sites) == 200


def test_one_foreign_origin_among_several_is_refused():
    assert status(asked(origins=["http://127.0.0.1:8080", "null"])) == 403


def test_default_port_may_be_omitted():
    guard = Guard(["robot:443"], encrypted=True)
    assert guard.refusal(Head("GET", ["robot"])) is None
    assert Guard(["robot:443"]).refusal(Head("GET", ["robot"])) is not None


def test_local_address_of_the_connection_is_accepted():
    assert status(asked("10.0.0.7:8080", local="10.0.0.7:8080")) == 200
    assert status(asked("10.0.0.8:8080", local="10.0.0.7:8080")) == 421


def test_server_on_the_network_accepts_the_name_of_the_machine():
    names = own_names("0.0.0.0", 1, machine="robot")
    assert {"robot:1", "robot.local:1", "localhost:1"} <= set(names)


@pytest.mark.parametrize(
    ("authorizations", "expected"),
    [
        (["Bearer secret"], 200),
        (["bearer   secret"], 200),
        (["Bearer wrong"], 401),
        (["Basic secret"], 401),
        (["secret"], 401),
        (["Bearer"], 401),
        ([], 401),
        (["Bearer secret", "Bearer secret"], 401),
    ],
)
def test_only_the_correct_token_is_accepted(authorizations, expected):
    head = asked(authorizations=authorizations)
    assert status(head, may_look="secret".__eq__) == expected


def test_wrong_host_is_refused_before_the_token_is_checked():
    head = asked("evil.example", authorizations=["Bearer secret"])
    assert status(head, may_look=pytest.fail) == 421


def granted(access, *, tokens=None, **head):
    head.setdefault("method", "POST" if access is Access.CONTROL else "GET")
    options = {"may_look": head.pop("may_look", None), "origins": head.pop("allowed", ())}
    refusal = Guard(HERE, tokens=tokens, **options).refusal(
        Head(hosts=["127.0.0.1:8080"], **head), access
    )
    return refusal.status if refusal else 200


PUBLIC = "https://lab.example"


def proxied(access, *, host="lab.example", allowed=(PUBLIC,), token="", origin="", **head):
    """The status of a request that a reverse proxy of this machine forwards."""
    tokens = Tokens("server's own")
    token = {"view": tokens.view, "control": tokens.control}.get(token, token)
    guard = Guard(HERE, tokens=tokens, origins=allowed, is_local=True)
    method = "POST" if access is Access.CONTROL else "GET"
    origins = [origin] if origin else []
    refusal = guard.refusal(
        Head(method, [host], origins=origins, authorizations=bearer(token), **head), access
    )
    return refusal.status if refusal else 200


@pytest.mark.parametrize(
    ("host", "allowed", "expected"),
    [
        ("lab.example", PUBLIC, 200),
        ("LAB.example:443", PUBLIC, 200),
        ("lab.example", "https://lab.example:443/", 200),
        ("lab.example:8443", "https://lab.example:8443", 200),
        ("lab.example", "https://lab.example:8443", 200),  # the proxy leaves the port out
        ("lab.example", "http://lab.example", 200),
        ("lab.example:80", PUBLIC, 421),
        ("lab.example", "https://other.example", 421),
        ("lab.example.evil.example", PUBLIC, 421),
        ("null", "null", 421),
        ("", "null", 421),
    ],
)
def test_name_of_an_allowed_origin_is_a_valid_host(host, allowed, expected):
    assert proxied(Access.LOAD, host=host, allowed=[allowed]) == expected


def test_refused_host_names_the_option_for_a_proxy():
    refusal = Guard(HERE).refusal(Head("GET", ["lab.example"]))
    assert refusal is not None
    assert "--allow-origin https://lab.example" in refusal.reason


@pytest.mark.parametrize(
    ("access", "token", "expected"),
    [
        (Access.LOAD, "", 200),
        (Access.MONITOR, "", 401),
        (Access.LOOK, "", 401),
        (Access.CONTROL, "", 401),
        (Access.CONNECT, "", 401),
        (Access.MONITOR, "view", 200),
        (Access.LOOK, "view", 200),
        (Access.CONTROL, "view", 401),
        (Access.CONNECT, "view", 401),
        (Access.LOOK, "control", 200),
        (Access.CONTROL, "control", 200),
        (Access.CONNECT, "control", 200),
    ],
)
def test_request_for_the_name_of_a_proxy_needs_a_token(access, token, expected):
    assert proxied(access, token=token) == expected
    assert proxied(access, token=token, origin=PUBLIC) == expected


def test_proxy_of_another_user_needs_the_token_of_the_server():
    for token, expected in (("server's own", 200), ("control", 401), ("", 401)):
        assert proxied(Access.CONTROL, token=token, is_other_user=True) == expected
        assert proxied(Access.LOOK, token=token, is_other_user=True) == expected


@pytest.mark.parametrize("access", [Access.LOOK, Access.CONTROL, Access.CONNECT])
@pytest.mark.parametrize(
    "origin", ["https://evil.example", "http://lab.example", "http://127.0.0.1:8080", "null"]
)
def test_page_of_another_server_is_refused_at_the_name_of_a_proxy(access, origin):
    assert proxied(access, token="control", origin=origin) == 403


def test_buttons_work_behind_a_proxy_that_replaces_the_host():
    head = {"host": "127.0.0.1:8080", "origin": PUBLIC}
    assert proxied(Access.CONTROL, token="control", **head) == 200
    assert proxied(Access.CONTROL, **head) == 401
    assert proxied(Access.CONTROL, token="control", allowed=(), **head) == 403
    assert proxied(Access.LOOK, token="control", **head) == 403


def bearer(token):
    return [f"Bearer {token}"]


@pytest.mark.parametrize("method", ["GET", "HEAD", "PUT", "DELETE", "OPTIONS"])
def test_control_accepts_only_post(method):
    tokens = Tokens()
    head = {"method": method, "authorizations": bearer(tokens.control)}
    assert granted(Access.CONTROL, tokens=tokens, **head) == 405


def test_control_needs_the_token_for_control_also_on_this_machine():
    tokens = Tokens()
    for token, expected in ((tokens.control, 200), (tokens.view, 401), ("", 401)):
        head = {"authorizations": bearer(token)}
        assert granted(Access.CONTROL, tokens=tokens, **head) == expected
    assert granted(Access.CONTROL) == 401


def test_other_users_of_the_machine_cannot_see_the_page_even_with_a_link():
    tokens = Tokens("server")
    for token, expected in ((tokens.control, 401), (tokens.view, 401), ("", 401), ("server", 200)):
        head = {"authorizations": bearer(token), "is_other_user": True}
        assert granted(Access.LOOK, tokens=tokens, **head) == expected
        assert granted(Access.CONNECT, tokens=tokens, **head) == expected
        assert granted(Access.CONTROL, tokens=tokens, **head) == expected
    assert granted(Access.LOOK, tokens=tokens) == 200


def test_page_for_other_machines_needs_a_token_and_its_files_need_none():
    tokens = Tokens()
    for access in (Access.LOOK, Access.MONITOR):
        for token, expected in ((tokens.view, 200), (tokens.control, 200), ("x", 401)):
            head = {"authorizations": bearer(token), "may_look": tokens.may_look}
            assert granted(access, tokens=tokens, **head) == expected
    assert granted(Access.LOAD, tokens=tokens, may_look=tokens.may_look) == 200


def test_websocket_needs_a_token_with_all_rights_beyond_this_machine(tmp_path):
    path = tmp_path / "accounts.json"
    path.write_text('{"accounts": {"ada": {"secret": "%s"}}}' % ("s" * 20), encoding="utf-8")
    path.chmod(0o600)
    tokens = Tokens("server", AccountSource(str(path)))
    account = "ada." + "s" * 20
    assert tokens.may_look(account)
    wanted = ((tokens.control, 200), ("server", 200), (tokens.view, 401), (account, 401), ("", 401))
    for token, expected in wanted:
        head = {"authorizations": bearer(token), "may_look": tokens.may_look}
        assert granted(Access.CONNECT, tokens=tokens, **head) == expected


@pytest.mark.parametrize(
    ("origin", "expected"),
    [
        ("http://localhost:3000", 200),
        ("https://127.0.0.1:1", 200),
        ("http://[::1]:8", 200),
        ("https://lab.example", 200),
        ("https://lab.example.evil", 403),
        ("http://localhost.evil.example", 403),
        ("http://evil.example#http://localhost", 403),
        ("file://localhost", 403),
        ("null", 403),
        ("http://[", 403),
        ("http://localhost:99999", 403),
    ],
)
def test_websocket_accepts_pages_of_this_machine_and_of_allowed_origins(origin, expected):
    head = {"origins": [origin], "allowed": ["https://Lab.example/"]}
    assert granted(Access.CONNECT, **head) == expected
    assert granted(Access.LOOK, **head) == 403


def test_websocket_refuses_pages_of_other_users_of_this_machine_unless_they_are_allowed():
    page = "http://localhost:3000"
    head = {"origins": [page], "is_page_of_other_user": True}
    assert granted(Access.CONNECT, **head) == 403
    assert granted(Access.CONNECT, allowed=[page], **head) == 200
    refusal = Guard(HERE).refusal(Head("GET", HERE[:1], **head), Access.CONNECT)
    assert refusal is not None
    assert refusal.reason == (
        "a page of another user's server, or of one that has ended, may not open a WebSocket here;"
        " the server allows it with --allow-origin http://localhost:3000"
    )


@pytest.mark.parametrize(
    ("origin", "port"),
    [
        ("http://localhost:3000", 3000),
        ("http://127.0.0.1", 80),
        ("https://[::1]", 443),
        ("http://lab.example:3000", None),
        ("http://localhost:99999", None),
        ("null", None),
    ],
)
def test_port_of_a_page_of_this_machine_is_in_its_origin(origin, port):
    assert local_port(origin) == port


def test_refusal_of_a_websocket_names_the_option_that_allows_the_page():
    head = Head("GET", ["127.0.0.1:8080"], origins=["http://lab.local:8000"])
    refusal = Guard(["127.0.0.1:8080"]).refusal(head, Access.CONNECT)
    assert refusal is not None
    assert refusal.reason == (
        "a page of another server may not open a WebSocket here;"
        " the server allows it with --allow-origin http://lab.local:8000"
    )


@given(st.text(), st.sampled_from(list(Access)), st.booleans(), st.text(max_size=20))
def test_no_text_without_a_token_gives_control(text, access, is_other_user, origin):
    tokens = Tokens()
    head = {"authorizations": [text], "is_other_user": is_other_user, "origins": [origin]}
    assert granted(Access.CONTROL, tokens=tokens, **head) != 200
    if is_other_user and access in (Access.LOOK, Access.CONNECT):
        assert granted(access, tokens=tokens, **head) != 200
