"""Decides from the head of a request whether the server accepts it, and for which user.

The first hazard is a browser on the robot's own machine: any web page can make it send requests
here, under a host name that resolves to this machine (DNS rebinding). So the Host header must
contain one of the server's own names, and requests from pages of other servers are refused. For an
image or a link, a browser sends no Origin header, but Sec-Fetch-Site says that another page asks.

The second hazard is another user of the machine. On Linux, only the server's own user may see the
live page without a token, and a page that another user serves may not open a WebSocket; `peers`
explains why other systems cannot check this.

The third hazard is a reverse proxy on this machine: its requests come from this machine, but its
users do not. So a request for the name of an allowed origin always needs a token.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Sequence
from enum import Enum
from urllib.parse import urlsplit

import msgspec

from taskrpc.observe.web.tokens import Holder, Tokens

LOOPBACK = ("127.0.0.1", "localhost", "::1")
_OTHER_PAGES = ("cross-site", "same-site")
"""Values of Sec-Fetch-Site. Browsers count all ports of one host as one site."""


class Access(Enum):
    """The kinds of requests, by what they need to be allowed."""

    MONITOR = "monitor"
    """Read `/health` or `/metrics`: on this machine, every user may."""
    LOAD = "load"
    """Load a file of the live page, which has no secrets: every user may."""
    LOOK = "look"
    """See what the live page shows: on this machine, the server's own user may. An image or a link
    of another page may not: `/live` and `/recording` keep a connection open."""
    CONTROL = "control"
    """Change something: only with a token that allows it."""
    CONNECT = "connect"
    """Open a WebSocket, which has the rights of the server: on this machine, the server's own user
    may, also with pages that this user serves and with those of allowed origins."""


class Head(msgspec.Struct, frozen=True):
    """The relevant parts of a request; a repeated header has several values."""

    method: str
    hosts: Sequence[str]
    local: str = ""
    """The local address of the connection, with its port; as a Host header it is always valid."""
    origins: Sequence[str] = ()
    sites: Sequence[str] = ()
    """The values of Sec-Fetch-Site: what a browser says about the page that asks."""
    authorizations: Sequence[str] = ()
    is_other_user: bool = False
    """Whether a process of another user of this machine has connected."""
    is_page_of_other_user: bool = False
    """Whether another user of this machine, or nobody, listens at the port of the origin."""

    @property
    def token(self) -> str:
        """The bearer token, "" for none."""
        return _bearer(self.authorizations)


class Refusal(msgspec.Struct, frozen=True):
    """An HTTP status and the reason as a sentence."""

    status: int
    reason: str


class Guard:
    """Accepts requests for one of `names` (each with its port) that have a valid token.

    Args:
        names: the server's own names.
        encrypted: whether the server uses TLS.
        may_look: returns whether a bearer token is valid; without it, only requests of other users
            and of proxies need one.
        is_local: whether requests need no token although `may_look` is given, except those of other
            users and of proxies.
        tokens: which tokens the live page accepts; without them, none.
        origins: other pages that may open a WebSocket, such as `https://lab.example`. If a reverse
            proxy serves this server's pages there, they may use it as the server's own address.
    """

    def __init__(
        self,
        names: Iterable[str],
        *,
        encrypted: bool = False,
        may_look: Callable[[str], bool] | None = None,
        is_local: bool = False,
        tokens: Tokens | None = None,
        origins: Iterable[str] = (),
    ) -> None:
        self._scheme = "https" if encrypted else "http"
        usual = ":443" if encrypted else ":80"
        given = {name.lower() for name in names}
        self._names = given | {name.removesuffix(usual) for name in given if name.endswith(usual)}
        self._may_look = may_look
        self._needs_token = may_look is not None and not is_local
        self._tokens = tokens
        self._origins = {_without_usual_port(origin.lower().rstrip("/")) for origin in origins}
        self._public_names = _hosts(self._origins) - self._names
        """The names under which a proxy forwards requests."""

    def refusal(self, head: Head, access: Access = Access.MONITOR) -> Refusal | None:
        """Return why a request is refused, None if it is accepted."""
        methods = ("POST",) if access is Access.CONTROL else ("GET", "HEAD")
        if head.method not in methods:
            problem = f"expected the method {' or '.join(methods)}, got {head.method[:40]}"
            return Refusal(405, problem)
        if len(head.hosts) != 1:
            return Refusal(400, f"expected one Host header, got {len(head.hosts)}")
        host = head.hosts[0].lower()
        if not host or (
            host not in self._names and host != head.local and host not in self._public_names
        ):
            return _host_refusal(host)
        for origin in head.origins:
            if not self._is_allowed(origin.lower(), host, access, head):
                return _origin_refusal(origin, access)
        for site in head.sites:
            if access is Access.LOOK and site in _OTHER_PAGES:
                return _origin_refusal(f"another page (Sec-Fetch-Site: {site})", access)
        return self._token_refusal(head, access)

    def _is_allowed(self, origin: str, host: str, access: Access, head: Head) -> bool:
        if host in self._public_names:  # the proxy may use another scheme than this server
            return origin in self._origins
        if origin == f"{self._scheme}://{host}":
            return True
        if origin in self._origins:  # a proxy that replaces the Host header shows the buttons there
            return access in (Access.CONNECT, Access.CONTROL)
        is_local = local_port(origin) is not None
        return access is Access.CONNECT and is_local and not head.is_page_of_other_user

    def _token_refusal(self, head: Head, access: Access) -> Refusal | None:
        if access is Access.LOAD:
            return None
        is_forwarded = head.hosts[0].lower() in self._public_names
        needs_token = self._needs_token or is_forwarded
        if access is Access.MONITOR:
            may_read = self._may_look or self._may_look_with_link
            is_valid = not needs_token or may_read(head.token)
        elif access is Access.CONTROL:
            is_valid = self.holder(head) is not None
        else:
            is_valid = not needs_token and not head.is_other_user
            may_pass = self._may_connect if access is Access.CONNECT else self._may_view
            is_valid = is_valid or may_pass(head)
        if is_valid:
            return None
        if access is Access.CONTROL:
            problem = "expected a token for control; open the page with the command: taskrpc view"
        elif head.is_other_user and not is_forwarded:
            problem = (
                "only the user who started the server may open this page without a token;"
                " send the server's token or the token of an account"
            )
        else:
            problem = "expected a valid token in the header: Authorization: Bearer TOKEN"
        return Refusal(401, problem)

    def holder(self, head: Head) -> Holder | None:
        """Return for whom a request may change something, None if it may not."""
        if self._tokens is None:
            return None
        return self._tokens.holder(head.token, of_links=not head.is_other_user)

    def _may_look_with_link(self, token: str) -> bool:
        return self._tokens is not None and self._tokens.may_look(token)

    def _may_view(self, head: Head) -> bool:
        if self._tokens is None:
            return self._may_look is not None and self._may_look(head.token)
        return self._tokens.may_look(head.token, of_links=not head.is_other_user)

    def _may_connect(self, head: Head) -> bool:
        """Whether a token gives the rights of the server's own user, as a WebSocket does."""
        if self._tokens is None:
            return self._may_view(head)
        holder = self.holder(head)
        return holder is not None and not holder.account


def _host_refusal(host: str) -> Refusal:
    proxy = f"behind a proxy, start it with --allow-origin https://{host[:100] or 'NAME'}"
    return Refusal(
        421, f"this server does not have the name {host[:100]!r}; use its address, or, {proxy}"
    )


def _origin_refusal(origin: str, access: Access) -> Refusal:
    if access is not Access.CONNECT:
        return Refusal(
            403, f"expected a request from a page of this server, got one from {origin[:100]}"
        )
    is_local = local_port(origin.lower()) is not None
    owner = "another user's server, or of one that has ended," if is_local else "another server"
    allow = f"the server allows it with --allow-origin {origin[:100]}"
    return Refusal(403, f"a page of {owner} may not open a WebSocket here; {allow}")


def own_names(listened: str, port: int, *, machine: str) -> list[str]:
    """Return the valid Host headers for a server that listens at an address of a machine."""
    hosts = [*LOOPBACK]
    if not listened.startswith("127.") and listened not in ("::1", "localhost"):
        hosts += [listened, machine, f"{machine}.local"]
    return [f"[{host}]:{port}" if ":" in host else f"{host}:{port}" for host in hosts]


def _without_usual_port(origin: str) -> str:
    """Return an origin as browsers write it: without the port that its scheme implies."""
    return origin.removesuffix(_usual_port(origin))


def _usual_port(origin: str) -> str:
    return ":443" if origin.startswith("https:") else ":80"


def _hosts(origins: Iterable[str]) -> set[str]:
    """Return the Host headers of origins; some proxies leave the port out, or always add it."""
    found = set()
    for origin in origins:
        _, is_url, authority = origin.partition("://")
        if is_url:
            host = re.sub(r":[0-9]+\Z", "", authority)
            found |= {authority, host, f"{host}{_usual_port(origin)}"}
    return found


def _bearer(authorizations: Sequence[str]) -> str:
    if len(authorizations) != 1:
        return ""
    scheme, _, token = authorizations[0].partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def local_port(origin: str) -> int | None:
    """Return the port of an origin of this machine, None for an origin of another machine."""
    try:
        parts = urlsplit(origin)
        port = parts.port or (443 if parts.scheme == "https" else 80)
    except ValueError:
        return None
    is_local = parts.scheme in ("http", "https") and parts.hostname in LOOPBACK
    return port if is_local else None
