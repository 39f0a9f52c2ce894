"""Asks a policy about each request: reads its file, again when it changes, and has the clock."""

from __future__ import annotations

import logging
import os
import time
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Protocol

from taskrpc.bridges.door.decisions import (
    Counts,
    Decision,
    Moment,
    decide,
    permits,
    refused,
)
from taskrpc.bridges.door.policy import DAY, Policy
from taskrpc.bridges.door.policy_file import Known, PolicyError, parse_policy
from taskrpc.errors import InvalidName
from taskrpc.spi import names, private_files, read_text, time_of_day

log = logging.getLogger("taskrpc.door")

CHECK_PERIOD = 1.0
"""Seconds after which a request makes the door look whether the file has changed."""

_KEPT_NAMES = 512
"""Names of requests that a door remembers with their meaning."""


class Resolver(Protocol):
    """What a name means: a node of taskrpc or of rclpy, with its remappings."""

    def resolve_service_name(self, name: str, /) -> str:
        """Return the absolute name of a service."""

    def resolve_topic_name(self, name: str, /) -> str:
        """Return the absolute name of a topic."""


class Door:
    """The policy of a file, for the requests that one node passes on.

    `node` is the node with which the bridge calls, reads and publishes; without it, names are
    relative to `/`. Raises PolicyError for a file with a mistake, or one that others can change.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        node: Resolver | None = None,
        *,
        now: Callable[[], Moment] | None = None,
    ) -> None:
        self._path = Path(path)
        self._node = node
        self._now = now or present
        self._resolved = lru_cache(_KEPT_NAMES)(self._resolve)
        self._counts = Counts()
        self._seen = _signature(self._path)
        self._checked_at = self._now().seconds
        self.policy = _read_trusted(self._path)
        """The rules in force."""

    def decide(self, name: str, verb: str, target: str, message: object = None) -> Decision:
        """Decide whether `name` may `call`, `read` or `publish` this now; a permission counts.

        `target` is a service, action or topic as the caller spells it. `message` is the decoded
        message that the bridge is about to pass on, with the defaults of missing fields.
        """
        moment = self._refreshed()
        try:
            absolute = self._resolved(verb, target)
        except InvalidName as error:
            return refused(f"{target!a}: {error.problem}")
        decision, self._counts = decide(
            self.policy, name, verb, absolute, message, moment, self._counts
        )
        return decision

    def permits(self, name: str, verb: str, target: str) -> bool:
        """Return whether `name` may do this with some message; nothing counts for a rate.

        `target` is an absolute name.
        """
        self._refreshed()
        return permits(self.policy, name, verb, target)

    def _refreshed(self) -> Moment:
        """Look whether the file has changed, if that is due; return the present time."""
        moment = self._now()
        if moment.seconds - self._checked_at >= CHECK_PERIOD:
            self._checked_at = moment.seconds
            self.refresh()
        return moment

    def refresh(self) -> bool:
        """Read the file again if it has changed; return whether other rules are in force now.

        While the file has a mistake, the last valid rules stay in force, and the log says so.
        """
        seen = _signature(self._path)
        if seen == self._seen:
            return False
        self._seen = seen
        try:
            self.policy = _read_trusted(self._path)
        except PolicyError as error:
            log.error("the policy stays as it was: %s", error)
            return False
        log.info("%s: new rules for %s", self._path, ", ".join(self.policy.names) or "no names")
        return True

    def _resolve(self, verb: str, target: str) -> str:
        is_service = verb == "call"
        if self._node is None:
            return names.expand(target, kind="service name" if is_service else "topic name")
        resolve = self._node.resolve_service_name if is_service else self._node.resolve_topic_name
        return resolve(target)


def read_policy(path: str | os.PathLike[str], known: Known | None = None) -> Policy:
    """Return the policy of a file. Raises PolicyError."""
    return parse_policy(policy_text(path), os.fspath(path), known)


def policy_text(path: str | os.PathLike[str]) -> str:
    """Return the text of a policy file. Raises PolicyError."""
    try:
        return read_text(path, "utf-8-sig")
    except OSError as error:
        problem = f"cannot read the policy: {error.strerror or error}"
    except UnicodeDecodeError:
        problem = "the policy is not UTF-8 text; save it as UTF-8"
    raise PolicyError(problem, os.fspath(path))


def present() -> Moment:
    """Return the present time."""
    return Moment(time.monotonic(), _minute_of_week(int(time_of_day() // 60)))


@lru_cache(1)
def _minute_of_week(minute: int) -> int:
    """Return the minute of the week in local time for a minute since 1970."""
    local = time.localtime(minute * 60)
    return local.tm_wday * DAY + local.tm_hour * 60 + local.tm_min


def _read_trusted(path: Path) -> Policy:
    """Return the policy of a file that no other user can change. Raises PolicyError."""
    try:
        with open(path, "rb") as file:
            is_ours = private_files.is_written_by_us_only(file.fileno())
    except OSError as error:
        raise PolicyError(f"cannot read the policy: {error.strerror}", str(path)) from None
    if not is_ours:
        problem = f"other users can change the policy; do `chmod go-w {path}` as its owner"
        raise PolicyError(problem, str(path))
    return read_policy(path)


def _signature(path: Path) -> object:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino, found.st_mode
