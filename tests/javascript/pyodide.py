"""Pyodide and the packages of the labs' page, from their registries by npm and pip."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from taskrpc.course.browser_lab.downloads import ARCHIVES, MSGSPEC, PYODIDE, PYYAML
from tests.javascript.packages import FOLDER, one_at_a_time, program

_ARCHIVES = FOLDER / "pyodide"


def archives() -> Path:
    """Return the folder with the archives; downloads them if one is missing."""
    with one_at_a_time():
        if not all((_ARCHIVES / archive.name).is_file() for archive in ARCHIVES):
            _download()
    return _ARCHIVES


def _download() -> None:
    npm = program("npm", package="nodejs npm")
    _ARCHIVES.mkdir(exist_ok=True)
    pip = [sys.executable, "-m", "pip", "download", "--quiet", "--no-deps", "--dest", "."]
    wheel = ["--only-binary=:all:", "--python-version=3.14", "--abi=cp314"]
    wheel += ["--implementation=cp", "--platform=pyemscripten_2026_0_wasm32"]
    source = ["--no-binary=pyyaml"]
    _run([npm, "pack", PYODIDE.name.removesuffix(".tgz").replace("-", "@", 1)])
    _run([*pip, *wheel, "==".join(MSGSPEC.name.split("-")[:2])])
    _run([*pip, *source, "==".join(PYYAML.name.removesuffix(".tar.gz").split("-"))])


def _run(command: list[str]) -> None:
    done = subprocess.run(command, cwd=_ARCHIVES, capture_output=True, text=True)
    assert done.returncode == 0, f"{command}: {done.stdout}{done.stderr}"
