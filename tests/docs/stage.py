"""Plays a page: writes its files, runs its programs and commands, compares what they say."""

from __future__ import annotations

import contextlib
import dataclasses
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from xml.etree import ElementTree

import srvgen
from taskrpc.bridges.door import parse_policy
from taskrpc.robot import parse_map
from taskrpc.ros.packages.rclpy._impl.parameters.yaml_parameters import ROS_PARAMETERS, read_file
from tests.installed import add_package

from .markdown import Block, Page
from .matching import normalised, pattern_of

_ROOT = Path(__file__).parents[2]
_PATIENCE = 60.0
_SETTLE = 0.1
_ASK_STATUS = "echo $?"
_SHOWN_PORT = "8642"
"""The port in the pages; tests replace it by a free port, so that they can run in parallel."""
_SCRIPTS = {
    **tomllib.loads((_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["scripts"],
    "pytest": "pytest:main",
}
_LAUNCH = """\
import importlib, sys
module, _, function = sys.argv.pop(1).partition(":")
sys.argv.pop(0)
sys.exit(getattr(importlib.import_module(module), function)())
"""
_OURS = ("TASKRPC_", "ROS_DOMAIN_ID", "AMENT_PREFIX_PATH", "COLUMNS", "NO_COLOR")
_POLICY = re.compile("^  may:", re.MULTILINE)
_PARSERS = {"srv": srvgen.parse_srv, "msg": srvgen.parse_msg, "action": srvgen.parse_action}


class Terminal:
    """A command that keeps running, and what it has said so far."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self._process = process
        self._said: list[str] = []
        self._matched = 0
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def expect(self, expected: str) -> None:
        """Wait until the command has said this, right after what it was seen to say before."""
        pattern = pattern_of(expected)

        def seen() -> bool:
            ended = self._process.poll() is not None and not self._reader.is_alive()
            said = normalised("".join(self._said)) + "\n"
            found = pattern.match(said, self._matched)
            assert found or not ended, f"expected\n{expected}\n--- got\n{said[self._matched :]}"
            self._matched = found.end() if found else self._matched
            return found is not None

        _wait_until(seen)

    def interrupt(self) -> None:
        """Press Ctrl-C and wait for the end."""
        if self._process.poll() is None:
            windows = sys.platform == "win32"
            self._process.send_signal(signal.CTRL_BREAK_EVENT if windows else signal.SIGINT)
        try:
            self._process.wait(_PATIENCE)
        finally:
            self._process.kill()
            self._reader.join(_PATIENCE)
            assert self._process.stdout
            self._process.stdout.close()

    def _read(self) -> None:
        assert self._process.stdout
        for line in self._process.stdout:
            self._said.append(line)


class Stage:
    """An empty folder in which a page is played from its first block to its last."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "page"
        self.folder.mkdir(parents=True)
        self._environment = _environment(folder)
        self._terminals: dict[str, Terminal] = {}
        self._status, self._output = 0, ""
        with socket.create_server(("127.0.0.1", 0)) as free:
            self._port = str(free.getsockname()[1])

    def play(self, page: Page) -> None:
        """Play a page; the first thing in it that is not true is an AssertionError."""
        try:
            for block in page.blocks:
                with _told_where(f"{page.path}:{block.line}"):
                    text = block.text.replace(_SHOWN_PORT, self._port)
                    self._play(dataclasses.replace(block, text=text))
            with _told_where(str(page.path)):
                self._doctest(page)
        finally:
            for terminal in self._terminals.values():
                terminal.interrupt()

    def _play(self, block: Block) -> None:
        if command := block.notes.get("started"):
            before = self._offers()
            self._start(command, command)
            _wait_until(lambda: self._offers() != before and self._is_settled())
        if "not run" in block.notes:
            return
        if block.file:
            path = self.folder / block.file
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(block.text + "\n", encoding="utf-8")
        if block.kind == "console":
            self._console(block)
        elif block.kind == "python" and not block.file:
            self._run([sys.executable, "-c", block.text])
            self._check_status("the program", 0)
        elif block.kind in ("srv", "msg", "action", "yaml", "xml"):
            _check_text(block)

    def _offers(self) -> list[str]:
        """What programs of this page have announced in the registry."""
        entries = (self.folder.parent / "xdg_runtime_dir").rglob("*.json")
        found = sorted(path.read_text(encoding="utf-8") for path in entries)
        return [entry for entry in found if re.search(r'"services?":\[+"', entry)]

    def _is_settled(self) -> bool:
        """Whether nothing is being announced: a program offers its services one by one."""
        offers = self._offers()
        time.sleep(_SETTLE)
        return offers == self._offers()

    # Commands

    def _console(self, block: Block) -> None:
        name = block.notes.get("terminal", "")
        commands = _commands(block.text)
        for index, (command, shown) in enumerate(commands):
            if command == "^C":
                self._terminals.pop(name).interrupt()
            elif not command:
                self._terminals[name].expect(shown)
            elif name:
                self._start(name, command)
                self._terminals[name].expect(shown)
            elif command != _ASK_STATUS:
                self._command(command, shown)
                self._check_status(command, _expected_status(block, commands[index + 1 :]))

    def _start(self, name: str, command: str) -> None:
        if before := self._terminals.pop(name, None):
            before.interrupt()
        arguments, environment = self._parsed(command)
        group = subprocess.CREATE_NEW_PROCESS_GROUP if sys.platform == "win32" else 0
        self._terminals[name] = Terminal(
            subprocess.Popen(
                arguments,
                cwd=self.folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                encoding="utf-8",
                creationflags=group,
            )
        )

    def _install(self) -> None:
        """Do what `pip install .` does with the entry points of the page's package.

        Its modules are in the page's folder, where programs find them. `tests/interop` installs
        such a package with pip.
        """
        project = tomllib.loads((self.folder / "pyproject.toml").read_text(encoding="utf-8"))
        project = project["project"]
        add_package(self.folder, project["name"], {}, project["entry-points"])

    def _command(self, command: str, shown: str) -> None:
        if command == "pip install .":
            self._install()
            return
        self._run(*self._parsed(command))
        said = normalised(self._output) + "\n"
        right = pattern_of(shown).fullmatch(said) if shown.strip() else not said.strip()
        assert right, f"$ {command}\n{shown}\n--- got\n{said}"
        # A program of the reader's may raise; a command may not.
        theirs = command.startswith(("python ", "taskrpc run ", "taskrpc simulate "))
        assert "Traceback" not in said or theirs, f"$ {command}\n{said}"

    def _check_status(self, what: str, expected: int) -> None:
        problem = f"{what}: expected exit code {expected}, got {self._status}\n{self._output}"
        assert self._status == expected, problem

    def _run(self, arguments: list[str], environment: dict[str, str] | None = None) -> None:
        ended = subprocess.run(
            arguments,
            cwd=self.folder,
            env=environment or self._environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            encoding="utf-8",
            timeout=_PATIENCE,
            check=False,
        )
        self._status, self._output = ended.returncode, ended.stdout

    def _parsed(self, command: str) -> tuple[list[str], dict[str, str]]:
        """A command line as arguments, and the environment with what it sets before them."""
        words, environment = shlex.split(command), dict(self._environment)
        while "=" in words[0]:
            name, _, value = words.pop(0).partition("=")
            environment[name] = value
        if words[0] == "python":
            return [sys.executable, *words[1:]], environment
        assert words[0] in _SCRIPTS, f"the test cannot run {words[0]}"
        return [sys.executable, "-c", _LAUNCH, _SCRIPTS[words[0]], *words], environment

    def _doctest(self, page: Page) -> None:
        """Run what the page shows of an interactive Python, all of it as one session."""
        blocks = [block.text for block in page.blocks if block.kind == "pycon"]
        if blocks:
            script = self.folder / "session.txt"
            script.write_text("\n\n".join(blocks) + "\n", encoding="utf-8")
            self._run([sys.executable, "-m", "doctest", "-o", "ELLIPSIS", str(script)])
            self._check_status("the session", 0)


@contextlib.contextmanager
def _told_where(place: str) -> Iterator[None]:
    try:
        yield
    except (AssertionError, ValueError, OSError, subprocess.TimeoutExpired) as problem:
        raise AssertionError(f"{place}: {problem}") from problem


def _wait_until(is_true: Callable[[], bool]) -> None:
    deadline = time.monotonic() + _PATIENCE
    while not is_true():
        assert time.monotonic() < deadline, f"nothing happened for {_PATIENCE:g} s"
        time.sleep(0.01)  # other processes make it true: they cannot wake us


def _commands(text: str) -> list[tuple[str, str]]:
    """Command and shown output, in order; output before any command has an empty one."""
    found: list[tuple[str, list[str]]] = []
    for line in text.splitlines():
        if line.startswith("$ ") or line == "^C":
            found.append((line.removeprefix("$ "), []))
        elif found:
            found[-1][1].append(line)
        else:
            found.append(("", [line]))
    return [(command, "\n".join(shown)) for command, shown in found]


def _expected_status(block: Block, following: list[tuple[str, str]]) -> int:
    """0, unless the page asks for it right afterwards or the block's notes say otherwise."""
    if following and following[0][0] == _ASK_STATUS:
        return int(following[0][1])
    return 0 if following else int(block.notes.get("exits", 0))


def _check_text(block: Block) -> None:
    """A definition, map or file of parameters must be valid, or, marked as wrong, must not."""
    with contextlib.ExitStack() as stack:
        if "wrong" in block.notes:
            stack.enter_context(_refused())
        if block.kind == "yaml" and ROS_PARAMETERS in block.text:
            read_file(block.text)
        elif block.kind == "yaml" and _POLICY.search(block.text):
            parse_policy(block.text)
        elif block.kind == "yaml":
            parse_map(block.text)
        elif block.kind == "xml":
            ElementTree.fromstring(block.text)
        else:
            package, name = _names(block)
            _PARSERS[block.kind](block.text, package, name)


@contextlib.contextmanager
def _refused() -> Iterator[None]:
    try:
        yield
    except ValueError:
        return
    raise AssertionError("marked as wrong, and it is right")


def _names(block: Block) -> tuple[str, str]:
    path = Path(block.file or "example_interfaces/srv/Example.srv")
    return path.parts[-3], path.stem


def _environment(folder: Path) -> dict[str, str]:
    """The user's environment without what steers us, with folders that only this page has."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith(_OURS)}
    for name in ("XDG_RUNTIME_DIR", "XDG_STATE_HOME", "LOCALAPPDATA", "ROS_LOG_DIR"):
        private = folder / name.lower()
        private.mkdir(mode=0o700)
        kept[name] = str(private)
    return {
        **kept,
        "PYTHONPATH": str(_ROOT),
        "PYTHONUNBUFFERED": "1",
        "PYTHONUTF8": "1",
        "COLUMNS": "100",
    }
