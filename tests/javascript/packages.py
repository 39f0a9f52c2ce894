"""Programs and npm packages that the tests in `tests/browser` and `tests/interop` need.

`package.json` pins the packages, and `package-lock.json` the contents of each.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import pytest

from taskrpc.core.system.file_locks import locked

FOLDER = Path(__file__).parent
_INSTALLED = FOLDER / "node_modules"


def program(*names: str, package: str) -> str:
    """Return the path of the first of these programs that is installed.

    Without any, the test is skipped. On a CI machine it fails, so that no test is left out unseen.
    """
    for name in names:
        if (path := shutil.which(name)) is not None:
            return path
    reason = f"expected {' or '.join(names)} on the PATH; on Debian: apt-get install {package}"
    if "CI" in os.environ:
        pytest.fail(reason)
    pytest.skip(reason)


def node_modules() -> Path:
    """Return the folder of the npm packages; installs them if it is missing or out of date."""
    npm = program("npm", package="nodejs npm")
    lock = FOLDER / "package-lock.json"
    installed = _INSTALLED / "installed-lock.json"
    with one_at_a_time():
        if not installed.exists() or installed.read_bytes() != lock.read_bytes():
            command = [npm, "ci", "--no-audit", "--no-fund", "--ignore-scripts"]
            done = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True)
            assert done.returncode == 0, f"npm ci failed: {done.stdout}{done.stderr}"
            shutil.copy(lock, installed)
    return _INSTALLED


def one_at_a_time() -> AbstractContextManager[None]:
    """Let other processes of the tests wait: they would install into the same folder."""
    return locked(FOLDER / "installing.lock")


def obstacle(package: str, node: str, lock: dict[str, Any]) -> str:
    """Return why a package cannot run in this version of Node (`v18.20.4`); "" if it can.

    `lock` is the content of `package-lock.json`, in which each package says what it needs.
    """
    needed = lock["packages"][f"node_modules/{package}"].get("engines", {}).get("node", ">=0")
    least = re.fullmatch(r">=\s*([\d.]+)", needed)
    assert least is not None, f"{package} needs Node {needed}, which this function cannot read"
    if _numbers(node) >= _numbers(least[1]):
        return ""
    return f"{package} needs Node {least[1]} or newer, got {node}; install a newer Node"


def _numbers(version: str) -> list[int]:
    return [int(each) for each in re.findall(r"\d+", version)]


def node_for(package: str) -> str:
    """Return the path of a Node that can run this package; otherwise the test is skipped.

    It is skipped on a CI machine too: the Node of Debian is older than roslib 2 needs, and
    `tests/browser` runs roslib 2 in Chromium.
    """
    node = program("node", package="nodejs")
    done = subprocess.run([node, "--version"], capture_output=True, text=True, check=True)
    lock = json.loads((FOLDER / "package-lock.json").read_text(encoding="utf-8"))
    if reason := obstacle(package, done.stdout.strip(), lock):
        pytest.skip(reason)
    return node
