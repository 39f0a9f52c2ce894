"""Programs and npm packages that the tests in `tests/browser` and `tests/interop` need.

`package.json` pins the packages, and `package-lock.json` the contents of each.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

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
    if not installed.exists() or installed.read_bytes() != lock.read_bytes():
        command = [npm, "ci", "--no-audit", "--no-fund", "--ignore-scripts"]
        done = subprocess.run(command, cwd=FOLDER, capture_output=True, text=True)
        assert done.returncode == 0, f"npm ci failed: {done.stdout}{done.stderr}"
        shutil.copy(lock, installed)
    return _INSTALLED
