"""`taskrpc doctor`: finds out why something does not work, here or at another address."""

from __future__ import annotations

import argparse
import asyncio
import json
from collections.abc import AsyncIterator

from msgspec.structs import asdict

from taskrpc.cli.ros.doctor import checks, middlewares, probe
from taskrpc.cli.ros.doctor.checks import Finding, problem
from taskrpc.cli.ros.doctor.loopback import loopback
from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import add_ignored
from taskrpc.cli.shared.remote import (
    Remote,
    add_secrets,
    add_transport,
    any_address,
    called_lab,
    remote_of,
)
from taskrpc.errors import TaskRpcError
from taskrpc.spi import is_loopback, is_unix, split_address


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of `doctor`."""
    what = "A server that you cannot reach, on another machine or at unix:/path; or a Zenoh router"
    parser.add_argument("connect", nargs="?", metavar="HOST:PORT", type=_address, help=what)
    add_transport(parser)
    add_secrets(parser)
    parser.add_argument("--json", action="store_true", help="Print a JSON array of findings")
    # The report always contains what these options of ros2 add.
    add_ignored(parser, "-r", "--report", action="store_true")
    add_ignored(parser, "-rf", "--report-failed", action="store_true")
    add_ignored(parser, "-iw", "--include-warnings", action="store_true")
    parser.set_defaults(run=_run)


def _address(text: str) -> str:
    if text != "unix:":
        return any_address(text)
    raise argparse.ArgumentTypeError("expected unix:/path of the server's socket, got unix: alone")


def _run(options: argparse.Namespace) -> int:
    found = asyncio.run(_report(remote_of(options), as_text=not options.json))
    problems = sum(finding.state == "problem" for finding in found)
    if options.json:
        print(json.dumps([asdict(finding) for finding in found]))
    else:
        print("no problems" if not problems else f"{problems} problem{'s'[: problems > 1]}")
    return Exit.ERROR if problems else Exit.DONE


async def _report(remote: Remote, *, as_text: bool) -> list[Finding]:
    """Return all findings; prints each at once, because some checks take seconds."""
    found = []
    async for finding in _findings(remote):
        found.append(finding)
        if as_text:
            _print(finding)
    return found


async def _findings(remote: Remote) -> AsyncIterator[Finding]:
    transports = middlewares.transports_of(remote)
    for check in (checks.software, checks.registry_folder, checks.environment):
        for finding in check():
            yield finding
    try:
        for transport in transports:
            async for finding in middlewares.examine(remote, transport):
                yield finding
        if remote.transport != "tcp":
            return
        async for finding in _over_tcp(remote):
            yield finding
    except TaskRpcError as error:
        # The folder or the domain is wrong; an earlier line says what to do.
        yield problem(f"cannot look for the programs of this machine: {error}", "see above")


async def _over_tcp(remote: Remote) -> AsyncIterator[Finding]:
    """Check the programs of this machine, and then the address that is given or the joined lab."""
    if (broken := loopback()) is not None:
        yield broken
    async for finding in checks.programs(reachable=broken is None):
        yield finding
    is_given = bool(remote.address)
    remote = remote if is_given else _lab_of(remote)
    if broken is not None and (not remote.address or _is_here(remote.address)):
        return  # nothing here can be called
    if remote.address:
        async for finding in probe.examine(remote):
            yield finding
            if finding.state == "problem":
                return  # its health services cannot be called either
        if not is_given:
            async for finding in checks.in_place_of_the_lab(remote):
                yield finding
    async for finding in checks.check_health(remote):
        yield finding


def _is_here(address: str) -> bool:
    return not is_unix(address) and is_loopback(split_address(address)[0])


def _lab_of(remote: Remote) -> Remote:
    """Return the joined lab if programs call it, otherwise `remote`."""
    if (lab := called_lab()) is None:
        return remote
    return Remote(lab.address, remote.tls, remote.token)


def _print(finding: Finding) -> None:
    print(f"{finding.state:8} {finding.text}", flush=True)
    if finding.advice:
        print(f"{'':8} -> {finding.advice}", flush=True)
