"""Fixtures: an empty workspace as working directory, the `srvgen` command, and mypy."""

from __future__ import annotations

import subprocess
import sys

import pytest

from srvgen.cli.main import main
from srvgen.files import search


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """An empty working directory from which nothing but the bundled packages is in reach."""
    folder = tmp_path / "workspace"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    monkeypatch.setattr(search, "_logged", set())
    return folder


@pytest.fixture
def run(capsys):
    """Runs `srvgen` with these arguments; its exit code, output and errors."""

    def call(*arguments):
        try:
            code = main([str(one) for one in arguments])
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()

    return call


@pytest.fixture(scope="session")
def mypy(tmp_path_factory):
    """Runs `mypy --strict` with these arguments in its own process; its lines.

    In ours it would leave a heap that every later collection of garbage walks. All runs share one
    cache, so that what they have in common (Python's own types, msgspec) is read once.
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
