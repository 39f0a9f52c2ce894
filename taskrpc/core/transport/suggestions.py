"""What a user can do about a service that no program offers: another name, another domain."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator

from taskrpc.core import names
from taskrpc.core.security.lab import remembered_lab
from taskrpc.core.system import folders
from taskrpc.core.transport.discovery.entries import RegistryEntry
from taskrpc.core.transport.discovery.registry import Registry
from taskrpc.core.transport.settings import domain_id, environment_peers

_SHOWN = 5  # most services that a suggestion names


def others(entries: Iterable[RegistryEntry]) -> list[RegistryEntry]:
    """Return the entries of all processes except this one."""
    return [entry for entry in entries if entry.pid != os.getpid()]


def services(entries: Iterable[RegistryEntry], *, hidden: bool = False) -> dict[str, list[str]]:
    """Return the offered services with their types; several types if servers disagree."""
    found: dict[str, set[str]] = {}
    for entry in entries:
        for service in entry.services:
            if hidden or not names.is_hidden(service.name):
                found.setdefault(service.name, set()).add(service.type_name)
    return {name: sorted(found[name]) for name in sorted(found)}


def domains() -> dict[int, list[RegistryEntry]]:
    """Return all taskrpc processes of this user on this machine, by domain."""
    found = {number: others(registry.entries()) for number, registry in _registries()}
    return {number: entries for number, entries in found.items() if entries}


def wrote_its_entries(pid: int) -> bool:
    """Return whether a process itself wrote the registry entries of this machine that name its id.

    True if the system does not tell; see `Registry.are_written_by`.
    """
    return all(registry.are_written_by(pid) for _, registry in _registries())


def _registries() -> Iterator[tuple[int, Registry]]:
    for folder in sorted(folders.runtime_dir().glob("domain_*")):
        number = folder.name.removeprefix("domain_")
        if number.isdecimal():
            yield int(number), Registry(int(number))


def suggestion(service: str) -> str:
    """Return what a user can do about a service that no program of this machine offers."""
    entries = domains().get(domain_id(), [])
    return like(service, entries, searches_domains=True) or nothing_offered()


def like(service: str, entries: Iterable[RegistryEntry], *, searches_domains: bool) -> str:
    """Return a hint with services that have a similar name, or with all; "" if there are none.

    `searches_domains`: whether the programs of this machine's other domains may offer the service.
    """
    from srvgen.definitions.names import similar_names

    known = services(entries, hidden=True)
    same_end = [name for name in known if name.endswith(service.rpartition("/")[2])]
    if similar := similar_names(service, known) or same_end:
        return f"did you mean {' or '.join(similar)}?"
    if searches_domains and (domain := _domain_of(service)) is not None:
        return f"it is offered in domain {domain}; set ROS_DOMAIN_ID={domain}"
    plain = [name for name in known if not names.is_hidden(name)]
    # Every node of a ROS program has some services besides its own.
    shown = [name for name in plain if not names.is_of_every_node(name)] or plain
    if not shown:
        return ""
    more = ", …" if len(shown) > _SHOWN else ""
    return f"there {'is' if len(shown) == 1 else 'are'} {', '.join(shown[:_SHOWN])}{more}"


def nothing_offered() -> str:
    """Return the hint if no program of this machine offers any service."""
    if (lab := remembered_lab()) and not environment_peers():
        return f"neither this machine nor the lab at {lab.address} offers a service: taskrpc doctor"
    where = f"on this machine in domain {domain_id()}"
    return f"no taskrpc program offers a service {where}; start one, for example taskrpc-server"


def _domain_of(service: str) -> int | None:
    """Return another domain in which programs of this machine offer a service."""
    for domain, entries in domains().items():
        if domain != domain_id() and service in services(entries, hidden=True):
            return domain
    return None
