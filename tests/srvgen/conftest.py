"""Fixtures: an empty workspace as working directory, the `srvgen` command, and mypy."""

from __future__ import annotations

import subprocess
import sys

import pytest

from srvgen.cli.main import main
from srvgen.files import search


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """An empty working directory; only the bundled packages can be found from it."""
    folder = tmp_path / "workspace"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(search, "_logged", set())
    return folder


@pytest.fixture
def run(capsys):
    """Runs `srvgen` with the arguments; returns its exit code, stdout and stderr."""

    def call(*arguments):
        try:
            code = main([str(one) for one in arguments])
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()

    return call


@pytest.fixture(scope="session")
def mypy(tmp_path_factory):
    """Runs `mypy --strict` with the arguments in its own process; returns its lines.

    In the test process it would leave many objects for the garbage collector. All runs share one
    cache, so that the types of Python and msgspec are read once.
    """
    call = [
        sys.executable,
        "-m",
        "mypy",
        "--strict",
        "--cache-dir",
        tmp_path_factory.mktemp("mypy"),
    ]

    def run(*arguments):
        done = subprocess.run(
            [str(one) for one in (*call, *arguments)], capture_output=True, text=True
        )
        assert not done.stderr
        return done.stdout.splitlines()

    return run
