"""The checks of `taskrpc doctor` on this machine."""

from __future__ import annotations

import asyncio
import os
import platform as machine
import sys
import tempfile
from collections.abc import AsyncIterator, Iterable, Iterator, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import msgspec

import srvgen
from taskrpc.cli.shared.processes import Process
from taskrpc.cli.shared.remote import HERE, LISTING_TIMEOUT, Remote, called_lab
from taskrpc.errors import ServiceUnavailable, TaskRpcError
from taskrpc.node import Node
from taskrpc.spi import (
    RegistryEntry,
    ServiceEndpoint,
    address_here,
    domain_id,
    environment_peers,
    file_locks,
    folders,
    is_unix,
    keepalive_of,
    names,
    path_of,
    private_files,
    process_state,
    suggestions,
)


class Finding(msgspec.Struct, frozen=True):
    """One line of the doctor's report."""

    state: str
    """`ok`, `note` or `problem`."""
    text: str
    advice: str = ""
    """What the user should do, "" for nothing."""


def ok(text: str) -> Finding:
    """Return a finding that reports no problem."""
    return Finding("ok", text)


def note(text: str, advice: str = "") -> Finding:
    """Return a finding that is no problem, but may explain one."""
    return Finding("note", text, advice)


def problem(text: str, advice: str) -> Finding:
    """Return a finding that the user must act on."""
    return Finding("problem", text, advice)


def software() -> Iterator[Finding]:
    """Check Python and the installed packages."""
    yield ok(f"Python {machine.python_version()} on {machine.system()}: {sys.executable}")
    for package in ("taskrpc", "msgspec", "PyYAML", "rich"):
        try:
            yield ok(f"{package} {version(package)}")
        except PackageNotFoundError:
            if package == "taskrpc":
                yield note("taskrpc runs from its source folder; it is not installed")
            else:
                yield problem(f"{package} is not installed", f"{sys.executable} -m pip install .")


def registry_folder() -> Iterator[Finding]:
    """Check the folder of the registry, and whether files in it can be locked."""
    try:
        folder = folders.runtime_dir()
        locks = _locks_work(folder)
    except (TaskRpcError, OSError) as error:
        advice = "set XDG_RUNTIME_DIR to a folder of yours that no other user can enter"
        yield problem(f"cannot use the folder in which programs find each other: {error}", advice)
        return
    if locks:
        yield ok(f"programs of this user find each other in {folder}")
    else:
        advice = "set XDG_RUNTIME_DIR to a folder on a disk of this machine"
        yield problem(f"files in {folder} cannot be locked", advice)


def environment() -> Iterator[Finding]:
    """Check the environment variables that affect programs."""
    try:
        where = "ROS_DOMAIN_ID" if os.environ.get("ROS_DOMAIN_ID") else "ROS_DOMAIN_ID is not set"
        yield ok(f"domain {domain_id()} ({where})")
    except TaskRpcError as error:
        yield problem(str(error), "set it to such a number, or unset it")
    if peers := environment_peers():
        listed = ", ".join(peers)
        yield note(f"TASKRPC_PEERS is set: programs call {listed}, not those of this machine")
    if os.environ.get("TASKRPC_TOKEN"):
        yield note("TASKRPC_TOKEN is set: servers that start now require it from other machines")
    try:
        if os.environ.get("TASKRPC_KEEPALIVE"):
            seconds = keepalive_of(None).dead_after
            yield note(
                f"TASKRPC_KEEPALIVE is set: silent machines count as lost after {seconds:g} s"
            )
    except TaskRpcError as error:
        yield problem(str(error), "set it to one of these values, or unset it")
    try:
        if lab := called_lab():
            yield ok(f"programs call the lab at {lab.address} too (taskrpc join --status)")
    except TaskRpcError as error:
        yield problem(str(error), "join again with the lecturer's string")
    for part in os.environ.get("TASKRPC_INTERFACE_PATH", "").split(os.pathsep):
        if part and not Path(part).is_dir():
            yield problem(
                f"TASKRPC_INTERFACE_PATH: expected folders of packages, got {part}",
                f"separate folders by {os.pathsep!r}; each holds folders such as my_pkg/srv",
            )


async def programs(*, reachable: bool = True) -> AsyncIterator[Finding]:
    """Check whether the programs of this machine respond, and whether their types agree.

    `reachable`: whether this machine can connect to its own addresses.
    """
    here = suggestions.domains().get(domain_id(), [])
    serving = [entry for entry in here if entry.services]
    if not serving:
        yield _nothing_offered()
    for entry in here:
        if Process(domain_id(), (entry,)).is_ending:
            yield note(f"{_program(entry)} offers no services any more: it is ending")
    for entry in serving:
        if reachable or is_unix(entry.address):
            yield await _reach(entry)
    for finding in _disagreements(serving):
        yield finding
    for domain, entries in suggestions.domains().items():
        if domain != domain_id() and (elsewhere := suggestions.services(entries)):
            advice = f"set ROS_DOMAIN_ID={domain} to call them"
            yield note(f"in domain {domain} there are {', '.join(elsewhere)}", advice)


def _nothing_offered() -> Finding:
    """Return what it means that no program of this machine offers a service."""
    text = f"no program of this machine offers a service in domain {domain_id()}"
    if peers := environment_peers():
        return note(f"{text}: programs call {', '.join(peers)} (TASKRPC_PEERS)")
    if (lab := called_lab()) is not None:
        # A task server here would take the calls that are meant for the lab.
        return note(f"{text}: all calls go to the lab at {lab.address}")
    return note(text, "start one, for example taskrpc-server")


async def in_place_of_the_lab(lab: Remote) -> AsyncIterator[Finding]:
    """Note the programs of this machine that take the calls of services of the joined lab."""
    offered = {each.name for each in await _services(lab) if not names.is_hidden(each.name)}
    for entry in suggestions.domains().get(domain_id(), []):
        if taken := [name for name in suggestions.services([entry]) if name in offered]:
            more = f" and {len(taken) - 1} more" if len(taken) > 1 else ""
            yield note(
                f"{_program(entry)} offers {taken[0]}{more}, as the lab at {lab.address} does: this"
                " machine's calls go to this program, not to the lab",
                f"to call the lab, end it: taskrpc stop {entry.pid}",
            )


async def _reach(entry: RegistryEntry) -> Finding:
    try:
        await HERE.listing(address_here(entry.address))
    except TaskRpcError as error:
        return _silent(entry, error)
    listed = ", ".join(suggestions.services([entry])) or "hidden services"
    return ok(f"{_program(entry)} at {entry.address} offers {listed}")


def _silent(entry: RegistryEntry, error: TaskRpcError) -> Finding:
    """Return why a program does not respond, although its registry entry shows that it runs."""
    if process_state.is_stopped(entry.pid):
        return problem(
            f"{_program(entry)} does not answer: it {process_state.STOPPED}",
            f"`fg` in its terminal or `kill -CONT {entry.pid}` continues it; `taskrpc stop"
            f" {entry.pid}` ends it",
        )
    if is_unix(entry.address) and not os.path.lexists(path := path_of(entry.address)):
        return problem(
            f"{_program(entry)} cannot be called: its socket {path} was removed",
            f"end it with `taskrpc stop {entry.pid}`, and start it again",
        )
    advice = (
        "a callback may block its event loop (its log names the callback), or the program hangs:"
        f" end it with `taskrpc stop {entry.pid}`, and if that does not help, with --force"
    )
    if entry.certificate:
        check = f"`taskrpc doctor {entry.address} --tls-ca FILE` checks its certificate"
        advice = f"{check}; or {advice}"
    return problem(f"{_program(entry)} does not answer: {error}", advice)


def _program(entry: RegistryEntry) -> str:
    return f"{entry.script} (pid {entry.pid}, in {entry.folder})"


def _disagreements(serving: Sequence[RegistryEntry]) -> Iterator[Finding]:
    """Report services whose definitions differ between programs."""
    first: dict[str, tuple[ServiceEndpoint, RegistryEntry]] = {}
    for entry in serving:
        for service in entry.services:
            known, owner = first.setdefault(service.name, (service, entry))
            if known.type_hash != service.type_hash:
                yield problem(
                    f"{service.name} is offered by {owner.script} as {known.type_name} and by"
                    f" {entry.script} as {service.type_name}, whose definitions differ",
                    f"end one of them: taskrpc stop {entry.pid}",
                )
        hashes = {each.type_name: each.type_hash for each in entry.services}
        for type_name, type_hash in hashes.items():
            yield from _differs_here(type_name, type_hash, entry)


def _differs_here(type_name: str, type_hash: str, entry: RegistryEntry) -> Iterator[Finding]:
    try:
        local = srvgen.type_hash(type_name)
    except srvgen.DefinitionError:
        yield note(f"{type_name}, which {entry.script} offers, is not defined on this machine")
        return
    if local != type_hash:
        yield problem(
            f"{entry.script} has another definition of {type_name} than this folder has",
            f"compare the .srv files, then start {entry.script} again",
        )


def _locks_work(folder: Path) -> bool:
    with tempfile.TemporaryDirectory(dir=folder) as inner:
        path = Path(inner, "lock")
        holder, other = private_files.open_private(path), private_files.open_private(path)
        try:
            return file_locks.try_lock(holder) and file_locks.is_locked(other)
        except OSError:
            return False
        finally:
            os.close(other)
            os.close(holder)


_HEALTH_TYPE = "std_srvs/srv/Trigger"


async def check_health(remote: Remote) -> AsyncIterator[Finding]:
    """Call the health services of this machine, or of HOST:PORT; nothing if none responds."""
    try:
        services = _health_services(await _services(remote))
    except TaskRpcError:
        return  # an earlier check has reported the reason
    async with remote.node() as node:
        for finding in await asyncio.gather(*(_health_of(node, name) for name in services)):
            if finding is not None:
                yield finding


async def _services(remote: Remote) -> Iterable[ServiceEndpoint]:
    if remote.address:
        return (await remote.listing(remote.address)).services
    here = suggestions.domains().get(domain_id(), [])
    return [service for entry in here for service in entry.services]


def _health_services(services: Iterable[ServiceEndpoint]) -> list[str]:
    triggers = {each.name for each in services if each.type_name == _HEALTH_TYPE}
    return sorted(name for name in triggers if name.endswith("/health"))


async def _health_of(node: Node, name: str) -> Finding | None:
    trigger = srvgen.load(_HEALTH_TYPE)
    try:
        client = node.create_client(trigger, name)
        response = await client.call(trigger.Request(), timeout=LISTING_TIMEOUT)
    except ServiceUnavailable:
        return None  # its server responds to nothing, which an earlier check has reported
    except TaskRpcError as error:
        return problem(f"{name} does not answer: {error}", "read the log of its server")
    if response.success:
        return ok(f"{name}: {response.message}")
    return problem(f"{name}: {response.message}", "wait a moment, or read the log of its server")
