"""The taskrpc processes of this user on this machine, as `ps`, `stop` and `doctor` see them."""

from __future__ import annotations

import time
from collections.abc import Iterable
from pathlib import Path

import msgspec

from taskrpc.spi import RegistryEntry, names, suggestions


class Process(msgspec.Struct, frozen=True):
    """A process; it has several entries if it uses several domains or event loops."""

    domain: int
    entries: tuple[RegistryEntry, ...]

    @property
    def pid(self) -> int:
        """Its process id."""
        return self.entries[0].pid

    @property
    def script(self) -> str:
        """The script's path as the user typed it."""
        return self.entries[0].script

    @property
    def folder(self) -> str:
        """The working directory."""
        return self.entries[0].folder

    @property
    def since(self) -> float:
        """When its first node started, in seconds since 1970."""
        return min(entry.since for entry in self.entries)

    @property
    def services(self) -> list[str]:
        """The services that it offers, without hidden ones."""
        return list(suggestions.services(self.entries))

    @property
    def is_ending(self) -> bool:
        """Whether it has withdrawn all services, and only answers earlier calls."""
        listens = any(entry.address for entry in self.entries)
        # A program also listens for the subscribers of its publishers.
        return listens and not any(entry.services or entry.publishers for entry in self.entries)

    def is_meant_by(self, name: str) -> bool:
        """Whether a pid, a script's name, a node or a service means this process."""
        nodes = {node for entry in self.entries for node in entry.nodes}
        offered = {service.name for entry in self.entries for service in entry.services}
        if name == str(self.pid) or _is_tail(name, Path(self.folder, self.script)):
            return True
        return f"/{name.removeprefix('/')}" in nodes | offered

    def __str__(self) -> str:
        return f"{self.script} (pid {self.pid})"


def _is_tail(name: str, script: Path) -> bool:
    """Whether a name is the end of a script's path, or all of it; `.py` may be missing."""
    wanted = Path(name).parts
    ends = (script.parts, script.with_suffix("").parts if script.suffix == ".py" else ())
    return bool(wanted) and any(parts[-len(wanted) :] == wanted for parts in ends)


def processes() -> list[Process]:
    """Return all processes except this one, oldest first."""
    found: dict[int, list[tuple[int, RegistryEntry]]] = {}
    for domain, entries in suggestions.domains().items():
        for entry in entries:
            found.setdefault(entry.pid, []).append((domain, entry))
    made = [
        Process(group[0][0], tuple(entry for _, entry in group))
        for group in found.values()
        if not all(_is_command(entry) for _, entry in group)
    ]
    return sorted(made, key=lambda process: process.since)


def clock_time(since: float) -> str:
    """Return an instant as text: the time if it is today, otherwise the date."""
    moment = time.localtime(since)
    today = moment[:3] == time.localtime()[:3]
    return time.strftime("%H:%M:%S" if today else "%Y-%m-%d", moment)


def listing(found: Iterable[Process]) -> str:
    """Return processes in one line."""
    return ", ".join(str(process) for process in found)


def _is_command(entry: RegistryEntry) -> bool:
    # Users want their own programs in a list, not a running command such as `service list`.
    return bool(entry.nodes) and not entry.services and all(map(names.is_hidden, entry.nodes))
