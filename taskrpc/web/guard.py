"""Who may see a page: decided from a request's head alone.

A browser on the robot's own machine is the danger: a page from anywhere may make it ask us, under
a name of its own that it has let point here (DNS rebinding). So the name asked for must be one of
ours, and a page from elsewhere gets nothing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import msgspec

LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Head(msgspec.Struct, frozen=True):
    """What counts of a request; a header that came several times has several values."""

    method: str
    hosts: Sequence[str]
    local: str = ""
    """The address, with its port, at which it arrived: one of ours, whatever its name is."""
    origins: Sequence[str] = ()
    authorizations: Sequence[str] = ()


class Refusal(msgspec.Struct, frozen=True):
    """A status of HTTP, and a sentence."""

    status: int
    reason: str


class Guard:
    """Lets requests in that name one of `names` (each with its port), and prove what they must.

    `may_look` says whether a bearer token is good enough; without it none is asked for.
    """

    def __init__(
        self,
        names: Iterable[str],
        *,
        encrypted: bool = False,
        may_look: Callable[[str], bool] | None = None,
    ) -> None:
        self._scheme = "https" if encrypted else "http"
        usual = ":443" if encrypted else ":80"
        given = {name.lower() for name in names}
        self._names = given | {name.removesuffix(usual) for name in given if name.endswith(usual)}
        self._may_look = may_look

    def refusal(self, head: Head) -> Refusal | None:
        """Why a request is refused, None if it is not."""
        if head.method not in ("GET", "HEAD"):
            return Refusal(405, "only GET and HEAD are answered here")
        if len(head.hosts) != 1:
            return Refusal(400, f"expected one Host header, got {len(head.hosts)}")
        host = head.hosts[0].lower()
        if not host or (host not in self._names and host != head.local):
            return Refusal(421, "this server has no such name; ask for it by its own address")
        if any(origin.lower() != f"{self._scheme}://{host}" for origin in head.origins):
            return Refusal(403, "pages from elsewhere may not ask here")
        if self._may_look is not None and not self._may_look(_bearer(head.authorizations)):
            return Refusal(401, "expected the server's secret: Authorization: Bearer SECRET")
        return None


def own_names(listened: str, port: int, *, machine: str) -> list[str]:
    """Under which `host:port` a server may be asked that listens at a host of a machine."""
    hosts = [*LOOPBACK]
    if not listened.startswith("127.") and listened not in ("::1", "localhost"):
        hosts += [listened, machine, f"{machine}.local"]
    return [f"[{host}]:{port}" if ":" in host else f"{host}:{port}" for host in hosts]


def _bearer(authorizations: Sequence[str]) -> str:
    if len(authorizations) != 1:
        return ""
    scheme, _, token = authorizations[0].partition(" ")
    return token.strip() if scheme.lower() == "bearer" else ""
