"""The file in which a task server notes the links of its live page, for `taskrpc view`.

The file is in the registry's folder, and only its user can read it. The server holds the file's
lock while it runs, so the file of a server that was killed is recognised.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from operator import itemgetter

import msgspec

from taskrpc.errors import TaskRpcError
from taskrpc.spi import domain_folder, domain_id, file_locks, is_loopback, split_address

CHECK = 2.0
"""Seconds between two checks that the file is still there."""
_LONGEST = 65_536
"""Bytes of the longest file that is read."""


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
        return is_loopback(split_address(self.url.rpartition("/")[2])[0])

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
        self._folder = domain_folder(domain_id())
        self._name = f"web-{link.pid}{robot}.page"
        self._link = link
        self._write(link)

    def _write(self, link: PageLink) -> None:
        with contextlib.suppress(FileNotFoundError):
            self._folder.remove(self._name)
        self._descriptor = self._folder.open(self._name, must_be_new=True)
        file_locks.lock(self._descriptor)
        os.write(self._descriptor, msgspec.json.encode(link))

    async def keep(self) -> None:
        """Write the file again whenever it was removed, until this task is cancelled."""
        while True:
            await asyncio.sleep(CHECK)
            with contextlib.suppress(OSError, TaskRpcError):  # the registry logs the reason
                old = self._descriptor
                if self._folder.renew() or os.fstat(old).st_nlink == 0:
                    self._write(self._link)
                    os.close(old)

    def close(self) -> None:
        """Remove the file."""
        os.close(self._descriptor)
        with contextlib.suppress(OSError):
            self._folder.remove(self._name)
        self._folder.close()


def noted_links() -> list[PageLink]:
    """Return the links of all running servers of this domain, the newest first."""
    folder, found = domain_folder(domain_id()), []
    for name in folder.names():
        if not (name.startswith("web-") and name.endswith(".page")):
            continue
        with contextlib.suppress(OSError, msgspec.MsgspecError):
            descriptor = folder.open_existing(name)
            with os.fdopen(descriptor, "rb") as file:
                if file_locks.is_locked(descriptor):  # else its server was killed
                    link = msgspec.json.decode(file.read(_LONGEST), type=PageLink)
                    found.append((os.fstat(descriptor).st_mtime_ns, link))
    folder.close()
    return [link for _, link in sorted(found, key=itemgetter(0), reverse=True)]
