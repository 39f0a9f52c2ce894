"""Run the checks of checks.toml in fresh virtual environments. All must pass before a landing.

    .ci/run                 all checks, as many at a time as keep the machine's cores busy
    .ci/run lint types      these checks
    .ci/run --here lint     in the environment of this Python, which needs the packages
    .ci/run --list          the checks, and how long they take

The output of a check appears when it ends. The exit code is 0 if all have passed, else 1.
In a fresh environment, a check that failed runs once more at the end, alone. If it passes then, one
of its tests depends on the load of the machine: that is a bug, which the last table shows.
A check whose programs are missing and cannot be installed is left out; with CI=1, it fails.
"""

from __future__ import annotations

import argparse
import glob
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
BIN = "Scripts" if sys.platform == "win32" else "bin"


@dataclass(frozen=True)
class Check:
    """One check of checks.toml, whose comment explains the fields."""

    name: str
    what: str
    run: list[str]
    environment: str
    minutes: float
    needs: list[str] = field(default_factory=list)
    cores: float = 1
    set: dict[str, str] = field(default_factory=dict)


class Environments:
    """Virtual environments by their extras, made in the order in which checks need them."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._locks: dict[str, threading.Lock] = {}
        self._lock = threading.Lock()

    def folder_of(self, extras: str) -> Path:
        """Return the folder of programs in an environment with these extras."""
        with self._lock:
            lock = self._locks.setdefault(extras, threading.Lock())
        home = self._folder / (extras.replace(",", "-") or "plain")
        ready = home / "ready"
        with lock:
            if not ready.exists():
                python = home / BIN / "python"
                subprocess.run([sys.executable, "-m", "venv", "--clear", home], check=True)
                wheel = self._wheel(python)
                package = f"{wheel}[{extras}]" if extras else wheel
                if not extras:
                    self._install([python, "-m", "pip"], package)
                elif extras == "test":
                    # Most modules are never imported; Python compiles the others.
                    self._install([python, "-m", "pip"], package, "--no-compile")
                else:  # uv takes seconds where pip takes minutes
                    self._install([python, "-m", "pip"], "uv")
                    self._install([python, "-m", "uv", "pip"], package, "--python", python)
                ready.touch()
        return home / BIN

    @staticmethod
    def _install(installer: list[str | Path], package: str, *options: str | Path) -> None:
        subprocess.run([*installer, "install", "--quiet", *options, package], check=True)

    def make(self, all_extras: Iterable[str]) -> None:
        """Begin to make environments; what goes wrong is reported by the first check of each."""
        makers = ThreadPoolExecutor(2)
        for extras in dict.fromkeys(all_extras):
            makers.submit(self.folder_of, extras)
        makers.shutdown(wait=False)

    def _wheel(self, python: Path) -> Path:
        """Return taskrpc's wheel, which the first environment builds for all."""
        folder = self._folder / "wheel"
        with self._lock:
            if not list(folder.glob("*.whl")):
                command = [python, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", folder, "."]
                subprocess.run(command, cwd=ROOT, check=True)
        (wheel,) = folder.glob("*.whl")
        return wheel


class Run:
    """The checks of one run, their results and their output."""

    def __init__(self, checks: Iterable[Check], environments: Environments | None) -> None:
        self._waiting = list(checks)
        self._environments = environments
        self._free: float = max(2, os.cpu_count() or 1)
        self._cores = self._free
        self._changed = threading.Condition()
        self._begin = time.monotonic()
        self._running: list[str] = []
        self.results: list[tuple[Check, bool, float]] = []

    def all(self) -> bool:
        """Run all checks; return whether they have passed."""
        threads = []
        while self._waiting:
            check = self._next()
            thread = threading.Thread(target=self._run, args=(check,))
            thread.start()
            threads.append(thread)
        for thread in threads:
            while thread.is_alive():
                thread.join(60)
                self._report()
        return all(passed for _, passed, _ in self.results)

    def _report(self) -> None:
        """Say which checks run, for those who wait for the first output."""
        with self._changed:
            if self._running:
                minutes = (time.monotonic() - self._begin) / 60
                print(f"-- {minutes:.0f} minutes: {', '.join(self._running)}", flush=True)

    def _next(self) -> Check:
        """Return the next check for which there are free cores."""
        with self._changed:
            check = self._waiting.pop(0)
            need = min(check.cores, self._cores)
            while not self._changed.wait_for(lambda: self._free >= need, timeout=60):
                self._report()
            self._free -= need
            self._running.append(check.name)
            return check

    def _run(self, check: Check) -> None:
        begin = time.monotonic()
        print(f"-- {check.name} starts: {check.what}", flush=True)
        with tempfile.TemporaryFile("w+b") as output:
            try:
                passed = self._passes(check, output)
            except (OSError, subprocess.SubprocessError) as error:
                output.write(f"{error}\n".encode())
                passed = False
            minutes = (time.monotonic() - begin) / 60
            with self._changed:
                self.results.append((check, passed, minutes))
                self._free += min(check.cores, self._cores)
                self._running.remove(check.name)
                self._changed.notify_all()
                output.seek(0)
                since = (time.monotonic() - self._begin) / 60
                verdict = "passed" if passed else "FAILED"
                print(f"== {check.name}: {check.what}", flush=True)
                sys.stdout.buffer.write(output.read())
                times = f"{minutes:.1f} minutes, {since:.1f} since the start"
                print(f"== {check.name} {verdict}: {times}", flush=True)

    def _passes(self, check: Check, output: object) -> bool:
        folder = Path(sys.executable).parent
        variables = {**os.environ, **check.set}
        if self._environments is not None:
            folder = self._environments.folder_of(check.environment)
            # Each program would compile the packages anew.
            variables.pop("PYTHONDONTWRITEBYTECODE", None)
        path = f"{folder}{os.pathsep}{os.environ['PATH']}"
        variables["PATH"] = path
        for line in [each for command in check.run for each in expanded(command)]:
            program, *words = shlex.split(line)
            found = shutil.which(program, path=path)
            if found is None:
                raise OSError(f"{program}: not found in {folder}")
            ended = subprocess.run(
                [found, *words],
                cwd=ROOT,
                env=variables,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                check=False,
            )
            if ended.returncode:
                return False
        return True


def expanded(line: str) -> list[str]:
    """Return a command once for each path that matches its last word, if that has a `*`."""
    command, _, last = line.rpartition(" ")
    if "*" not in last:
        return [line]
    return [f"{command} {path}" for path in sorted(glob.glob(last, root_dir=ROOT))]


def missing(programs: Mapping[str, Mapping[str, str]], names: Iterable[str]) -> list[str]:
    """Return the programs that this machine does not have."""
    return [
        name
        for name in names
        if shutil.which(name) is None and not glob.glob(programs[name].get("path", ""))
    ]


def install(programs: Mapping[str, Mapping[str, str]], names: list[str]) -> None:
    """Install the Debian packages of programs, if this machine and user can."""
    root = [] if not hasattr(os, "geteuid") or os.geteuid() == 0 else ["sudo", "-n"]
    if not names or shutil.which("apt-get") is None:
        return
    packages = sorted({programs[name]["debian"] for name in names})
    options = ["-qq", "--no-install-recommends"]
    quiet = {
        "stdout": subprocess.DEVNULL,
        "env": {**os.environ, "DEBIAN_FRONTEND": "noninteractive"},
    }
    subprocess.run([*root, "apt-get", "update", "-qq"], check=False, **quiet)
    subprocess.run([*root, "apt-get", "install", *options, *packages], check=False, **quiet)


def main() -> int:
    """Run what the command line names; return the exit code."""
    table = tomllib.loads((ROOT / ".ci" / "checks.toml").read_text(encoding="utf-8"))
    checks = {each["name"]: Check(**each) for each in table["check"]}
    parser = argparse.ArgumentParser(
        prog=".ci/run", description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("names", nargs="*", metavar="NAME", choices=[[], *checks])
    parser.add_argument("--here", action="store_true")
    parser.add_argument("--list", action="store_true")
    options = parser.parse_args()
    chosen = [checks[name] for name in options.names or checks]
    if options.list:
        print("\n".join(f"{each.name:<10} {each.minutes:>4} min  {each.what}" for each in chosen))
        return 0
    programs = table["programs"]
    install(
        programs, missing(programs, dict.fromkeys(each for one in chosen for each in one.needs))
    )
    ready, failed = [], False
    for check in chosen:
        if lacking := missing(programs, check.needs):
            print(f"== {check.name} LEFT OUT: this machine lacks {', '.join(lacking)}", flush=True)
            failed |= bool(os.environ.get("CI"))
        else:
            ready.append(check)
    with tempfile.TemporaryDirectory(prefix="taskrpc-checks-") as folder:
        environments = None if options.here else Environments(Path(folder))
        if environments is not None:
            environments.make(check.environment for check in ready)
        run = Run(ready, environments)
        if not run.all():
            again = (
                [] if options.here else [check for check, passed, _ in run.results if not passed]
            )
            failed |= not again
            for check in again:
                second = Run([check], environments)
                failed |= not second.all()
                run.results += second.results
    print("\nminutes")
    for check, passed, minutes in run.results:
        print(f"{check.name:<10} {minutes:>5.1f}  {'passed' if passed else 'FAILED'}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
