"""Start-up times of servers and commands, and the modules that commands import."""

from __future__ import annotations

import subprocess
import sys
import time

from benchmarks.harness.processes import ChildFailed, Pair
from benchmarks.harness.results import Results
from benchmarks.harness.rounds import Field

_COMMANDS = {
    "python -c pass": ["-c", "pass"],
    'python -c "import asyncio"': ["-c", "import asyncio"],
    "taskrpc --help": ["-m", "taskrpc", "--help"],
    "taskrpc-call /add a=1 b=2": ["-m", "taskrpc.cli.call", "/add", "a=1", "b=2"],
}


_PROFILED = ("taskrpc --help", "taskrpc-call /add a=1 b=2")
_OURS = ("taskrpc", "srvgen", "msgspec", "asyncio")


def measure_start_up(field: Field, *, rounds: int, results: Results) -> None:
    """Restart each contender's server in turn while its client waits."""
    for number in range(rounds):
        for pair in [field.baseline, *field.others(number)]:
            if not pair.contender.one_process:
                try:
                    seconds = pair.restart()
                except ChildFailed as error:
                    field.drop(pair, error)
                    results.start_up.pop(pair.contender.name, None)
                else:
                    results.start_up.setdefault(pair.contender.name, []).append(seconds)


def measure_commands(server: Pair, *, rounds: int, results: Results) -> None:
    """Run the command lines, one of which calls this server."""
    for _ in range(rounds):
        for name, arguments in _COMMANDS.items():
            begin = time.perf_counter()
            subprocess.run(
                [sys.executable, *arguments], env=server.env, check=True, stdout=subprocess.DEVNULL
            )
            results.commands.setdefault(name, []).append(time.perf_counter() - begin)
    for name in _PROFILED:
        results.imports[name] = _imports(_COMMANDS[name], server)


def _imports(arguments: list[str], server: Pair) -> dict[str, tuple[int, float]]:
    """Modules and their own seconds, by package, as `-X importtime` tells them."""
    told = subprocess.run(
        [sys.executable, "-X", "importtime", *arguments],
        env=server.env,
        check=True,
        capture_output=True,
        text=True,
    ).stderr
    packages: dict[str, tuple[int, float]] = {}
    for line in told.splitlines():
        own, _, module = (part.strip() for part in line.partition(":")[2].partition("|"))
        if line.startswith("import time:") and own.isdecimal():
            package = module.rpartition("|")[2].strip().partition(".")[0]
            package = package if package in _OURS else "the rest of Python"
            modules, seconds = packages.get(package, (0, 0.0))
            packages[package] = modules + 1, seconds + int(own) * 1e-6
    return packages
