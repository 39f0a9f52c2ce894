"""The file in which a task server notes the links of its live page, for `taskrpc view`.

The file is in the registry's folder, and only its user can read it. The server holds the file's
lock while it runs, so the file of a server that was killed is recognised.
"""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import msgspec

from taskrpc import platform
from taskrpc.transport.settings import domain_id
from taskrpc.transport.tcp.tcp_network import is_loopback, split_place

_FLAGS = os.O_RDWR | getattr(os, "O_BINARY", 0) | getattr(os, "O_NOFOLLOW", 0)


class PageLink(msgspec.Struct, frozen=True):
    """The address of a live page, and the tokens of its links."""

    pid: int
    """The process of the server."""
    url: str
    """Such as `http://127.0.0.1:8642`."""
    view: str
    """The token that allows to see the page; the page of this machine needs none."""
    control: str
    """The token that allows control."""
    service: str = "/robot_task"
    """The service whose tasks the page shows."""

    def __repr__(self) -> str:
        # Without the tokens, which must not appear in logs.
        return f"PageLink(pid={self.pid!r}, url={self.url!r})"

    @property
    def is_local(self) -> bool:
        """Whether only this machine can reach the page, so that the plain link shows it."""
        return is_loopback(split_place(self.url.rpartition("/")[2])[0])

    @property
    def control_link(self) -> str:
        """The link for control."""
        return f"{self.url}/#control={self.control}"

    @property
    def view_link(self) -> str:
        """The link that only shows."""
        return f"{self.url}/" if self.is_local else f"{self.url}/#view={self.view}"

    @property
    def projector_link(self) -> str:
        """The link that only shows, in large letters."""
        return self.view_link.replace(f"{self.url}/", f"{self.url}/?projector", 1)


class NotedLink:
    """The file of one server; `close` removes it. Raises OSError if it cannot be written."""

    def __init__(self, link: PageLink) -> None:
        robot = link.service.removesuffix("/robot_task").replace("/", "_")
        self._path = _folder() / f"web-{link.pid}{robot}.page"
        self._path.unlink(missing_ok=True)
        self._descriptor = platform.open_private(self._path, must_be_new=True)
        platform.lock(self._descriptor)
        os.write(self._descriptor, msgspec.json.encode(link))

    def close(self) -> None:
        """Remove the file."""
        os.close(self._descriptor)
        with contextlib.suppress(OSError):
            self._path.unlink()


def noted_links() -> list[PageLink]:
    """Return the links of all running servers of this domain, the newest first."""
    found = []
    for path in sorted(_folder().glob("web-*.page"), key=_changed_at, reverse=True):
        with contextlib.suppress(OSError, msgspec.MsgspecError):
            descriptor = os.open(path, _FLAGS)
            try:
                if not platform.is_locked(descriptor):  # its server was killed
                    continue
                with os.fdopen(os.dup(descriptor), "rb") as file:
                    found.append(msgspec.json.decode(file.read(), type=PageLink))
            finally:
                os.close(descriptor)
    return found


def _folder() -> Path:
    return platform.private_dir(platform.runtime_dir() / f"domain_{domain_id()}")


def _changed_at(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0
