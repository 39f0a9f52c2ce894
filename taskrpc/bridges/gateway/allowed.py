"""Which names of the robot other machines may use. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterable
from fnmatch import fnmatchcase

from taskrpc.spi import names

_PATTERN = re.compile(r"/?(?:[A-Za-z0-9_*?]+/)*[A-Za-z0-9_*?]+")


class Allowed:
    """A list of names with `*` and `?`, such as `/arm/*`; `*` stands for slashes too.

    Hidden names (a part begins with `_`) are never allowed. A pattern allows one of the services
    that every node of ROS has only if the pattern itself ends with its name, such as
    `/arm/get_parameters`.

    Raises ValueError for a pattern that can match no name.
    """

    def __init__(self, patterns: Iterable[str]) -> None:
        self._patterns = {each: _absolute(each) for each in patterns}
        """The absolute pattern by the one that was given."""

    def unused(self, names: Iterable[str]) -> list[str]:
        """Return the patterns that allow none of these names."""
        present = list(names)
        return [
            given
            for given, pattern in self._patterns.items()
            if not any(_allows(pattern, each) for each in present)
        ]

    def __contains__(self, name: str) -> bool:
        return any(_allows(pattern, name) for pattern in self._patterns.values())


def _allows(pattern: str, name: str) -> bool:
    return (
        not names.is_hidden(name)
        and fnmatchcase(name, pattern)
        and (not names.is_of_every_node(name) or _last_part(name) == _last_part(pattern))
    )


def _absolute(pattern: str) -> str:
    if not _PATTERN.fullmatch(pattern):
        raise ValueError(f"expected a name such as /arm/open or '/arm/*', got {pattern!r}")
    if pattern.startswith("_") or "/_" in pattern:
        problem = "expected no part that begins with _, because hidden names are never allowed"
        raise ValueError(f"{problem}; got {pattern!r}")
    return pattern if pattern.startswith(("/", "*")) else f"/{pattern}"


def _last_part(name: str) -> str:
    return name.rpartition("/")[2]
