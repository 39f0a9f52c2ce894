"""Writes the files of new packages, and finds the maintainer and the licence text for them."""

from __future__ import annotations

import getpass
import re
import shutil
import subprocess
from datetime import UTC, datetime
from pathlib import Path

_TEXTS = Path(__file__).with_name("license_texts")

LICENSES = (
    "Apache-2.0",
    "BSL-1.0",
    "BSD-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "GPL-3.0-only",
    "LGPL-2.1-only",
    "LGPL-3.0-only",
    "MIT",
    "MIT-0",
)
"""The licences that the tools of ROS 2 know, by their identifiers."""


def maintainer() -> tuple[str, str]:
    """The name and the mail address of this user, as the system and git know them."""
    try:
        name = getpass.getuser()
    except (OSError, KeyError, ImportError):  # ImportError: Windows without USERNAME
        name = "user"
    local = re.sub(r"[^\w.-]", "_", name)
    return name, _git_email() or f"{local}@todo.todo"


def write(path: Path, text: str) -> None:
    """Write a file and create the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")


def license_text(name: str, holder: str) -> str:
    """The text of a licence with this year and holder, or "" if taskrpc does not contain it."""
    path = _TEXTS / f"{name}.txt"
    if name not in LICENSES or not path.is_file():
        return ""
    text = path.read_text(encoding="utf-8")
    return text.replace("{year}", str(datetime.now(UTC).year)).replace("{holder}", holder)


def _git_email() -> str:
    git = shutil.which("git")
    if git is None:
        return ""
    command = [git, "config", "user.email"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    return done.stdout.strip()
