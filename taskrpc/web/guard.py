"""Decides from the head of a request whether to answer it.

The hazard is a browser on the robot's own machine: any web page can make it send requests here,
under a host name that resolves to this machine (DNS rebinding). So the Host header must contain one
of the server's own names, and pages of other servers get no answer.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from urllib.parse import urlsplit

import msgspec

LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Head(msgspec.Struct, frozen=True):
    """The relevant parts of a request; a repeated header has several values."""

    method: str
    hosts: Sequence[str]
    local: str = ""
    """The local address of the connection, with its port; as a Host header it is always valid."""
    origins: Sequence[str] = ()
    authorizations: Sequence[str] = ()


class Refusal(msgspec.Struct, frozen=True):
    """An HTTP status and the reason as a sentence."""

    status: int
    reason: str


class Guard:
    """Accepts requests for one of `names` (each with its port) that have a valid token.

    `may_look` returns whether a bearer token is valid; without it, no token is needed. `origins`
    are pages that may open a WebSocket, such as `https://lab.example`.
    """

    def __init__(
        self,
        names: Iterable[str],
        *,
        encrypted: bool = False,
        may_look: Callable[[str], bool] | None = None,
        origins: Iterable[str] = (),
    ) -> None:
        self._scheme = "https" if encrypted else "http"
        usual = ":443" if encrypted else ":80"
        given = {name.lower() for name in names}
        self._names = given | {name.removesuffix(usual) for name in given if name.endswith(usual)}
        self._may_look = may_look
        self._origins = {origin.lower().rstrip("/") for origin in origins}

    def refusal(self, head: Head, *, connects: bool = False) -> Refusal | None:
        """Return why a request is refused, None if it is accepted.

        With `connects`, the request is for a WebSocket, which all pages of this machine may open.
        """
        if head.method not in ("GET", "HEAD"):
            return Refusal(405, "only GET and HEAD are answered here")
        if len(head.hosts) != 1:
            return Refusal(400, f"expected one Host header, got {len(head.hosts)}")
        host = head.hosts[0].lower()
        if not host or (host not in self._names and host != head.local):
            return Refusal(421, "this server does not have this name; use its address")
        if not all(self._is_allowed(origin.lower(), host, connects) for origin in head.origins):
            return Refusal(403, "requests from pages of other servers are refused")
        if self._may_look is not None and not self._may_look(_bearer(head.authorizations)):
            return Refusal(401, "expected the server's secret: Authorization: Bearer SECRET")
        return None

    def _is_allowed(self, origin: str, host: str, connects: bool) -> bool:
        if origin == f"{self._scheme}://{host}":
            return True
        return connects and (origin in self._origins or _is_local(origin))


def own_names(listened: str, port: int, *, machine: str) -> list[str]:
    """Return the valid Host headers for a server that listens at an address of a machine."""
    hosts = [*LOOPBACK]
    if not listened.startswith("127.") and listened not in ("::1", "localhost"):
        hosts += [listened, machine, f"{machine}.local"]
    return [f"[{host}]:{port}" if ":" in host else f"{host}:{port}" for host in hosts]


def _bearer(authorizations: Sequence[str]) -> str:
    if len(authorizations) != 1:
        return ""
    scheme, _, token = authorizations[0].partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""


def _is_local(origin: str) -> bool:
    """Whether a page comes from a server of this machine, at any port."""
    try:
        parts = urlsplit(origin)
        return parts.scheme in ("http", "https") and parts.hostname in LOOPBACK
    except ValueError:
        return False
