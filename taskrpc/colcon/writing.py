"""Writes packages, and knows who writes them."""

from __future__ import annotations

import getpass
import re
import shutil
import subprocess
from pathlib import Path


def maintainer() -> tuple[str, str]:
    """Name and mail address of this user, as far as the system and git know them."""
    try:
        name = getpass.getuser()
    except (OSError, KeyError, ImportError):  # ImportError: Windows, no variable says it
        name = "user"
    local = re.sub(r"[^\w.-]", "_", name)
    return name, _git_email() or f"{local}@todo.todo"


def write(path: Path, text: str) -> None:
    """Write one file, making the folders above it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8", newline="\n")


def _git_email() -> str:
    git = shutil.which("git")
    if git is None:
        return ""
    command = [git, "config", "user.email"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=False)
    return done.stdout.strip()
