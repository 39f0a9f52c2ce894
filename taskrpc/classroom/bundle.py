"""The offline installation for a class: a folder of wheels, and instructions for students."""

from __future__ import annotations

import base64
import hashlib
import subprocess
import sys
import tomllib
import zipfile
from collections.abc import Callable, Sequence
from importlib import metadata
from pathlib import Path

from taskrpc.errors import TaskRpcError

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
"""Versions of Python on the laptops."""

SYSTEMS = {
    "Windows": ("win_amd64",),
    "macOS (Apple silicon)": ("macosx_11_0_arm64",),
    "macOS (Intel)": ("macosx_11_0_x86_64",),
    "Linux": ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
    "Linux (ARM)": ("manylinux_2_28_aarch64", "manylinux_2_17_aarch64", "manylinux2014_aarch64"),
}
"""Systems of the laptops, and the tags that pip knows for the wheels of each."""

INSTALL = "INSTALL.txt"

_PACKAGE = "taskrpc"
_TAG = "py3-none-any"
# The installer writes these files; they describe one installation.
_NOT_IN_A_WHEEL = {"RECORD", "INSTALLER", "REQUESTED", "direct_url.json"}

Pip = Callable[[Sequence[str], str], None]
"""Runs pip with arguments; the text names the purpose in errors. Raises TaskRpcError."""


def make_bundle(
    folder: Path, pythons: Sequence[str], report: Callable[[str], object], pip: Pip | None = None
) -> Path:
    """Fill a folder with taskrpc's own wheel, its dependencies, and `INSTALL.txt`.

    `report` is called with one line for each step. Returns taskrpc's own wheel.

    Raises:
        TaskRpcError: a wheel cannot be made or downloaded; the folder is not complete.
    """
    pip = pip or _run_pip
    try:
        folder.mkdir(parents=True, exist_ok=True)
        report("taskrpc's own wheel")
        wheel = make_own_wheel(folder, pip)
        for system, tags in SYSTEMS.items():
            for python in pythons:
                what = f"{system}, Python {python}"
                report(what)
                pip(_download(folder, wheel, tags, python), what)
        (folder / INSTALL).write_text(_how_to_install(wheel, pythons), encoding="utf-8")
    except FileExistsError:
        raise TaskRpcError(f"{folder}: expected a folder, found a file") from None
    except OSError as error:
        raise TaskRpcError(f"{error.filename or folder}: {error.strerror or error}") from None
    return wheel


def make_own_wheel(folder: Path, pip: Pip) -> Path:
    """Make taskrpc's own wheel: from its source, or else from what is installed.

    Raises TaskRpcError.
    """
    root = Path(__file__).resolve().parents[2]
    if _is_source(root):
        pip(["wheel", "--no-deps", "--wheel-dir", str(folder), str(root)], "taskrpc's own wheel")
        made = sorted(folder.glob(f"{_PACKAGE}-*.whl"), key=lambda path: path.stat().st_mtime)
        return made[-1]
    try:
        return pack_installed(metadata.distribution(_PACKAGE), folder)
    except metadata.PackageNotFoundError:
        raise TaskRpcError(
            f"taskrpc at {root} is neither installed nor a source checkout, so no wheel can be made"
            " of it; run this command from an environment in which `pip install` has installed it"
        ) from None


def pack_installed(found: metadata.Distribution, folder: Path) -> Path:
    """Rebuild the wheel from the files that pip has installed. Raises TaskRpcError."""
    name = f"{_PACKAGE}-{found.version}"
    path = folder / f"{name}-{_TAG}.whl"
    if not found.files:
        raise TaskRpcError(
            "the files of taskrpc are unknown, because pip did not install it; run this command"
            " from a source checkout, or from an environment in which pip has installed taskrpc"
        )
    lines = []
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as wheel:
        for file in found.files:
            if file.parts[0] == ".." or "__pycache__" in file.parts or file.name in _NOT_IN_A_WHEEL:
                continue
            data = Path(str(file.locate())).read_bytes()
            digest = base64.urlsafe_b64encode(hashlib.sha256(data).digest()).decode().rstrip("=")
            lines.append(f"{file.as_posix()},sha256={digest},{len(data)}")
            wheel.writestr(file.as_posix(), data)
        record = f"{name}.dist-info/RECORD"
        wheel.writestr(record, "\n".join([*lines, f"{record},,", ""]))
    return path


def _is_source(root: Path) -> bool:
    try:
        project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return False
    return bool(project.get("project", {}).get("name") == _PACKAGE)


def _download(folder: Path, wheel: Path, tags: Sequence[str], python: str) -> list[str]:
    platforms = [part for tag in tags for part in ("--platform", tag)]
    # The wheel's path, not its name: an index may have another package of this name.
    wanted = f"{wheel}[tls]"
    only = "--only-binary=:all:"
    return ["download", "--dest", str(folder), only, *platforms, "--python-version", python, wanted]


def _run_pip(arguments: Sequence[str], what: str) -> None:
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.returncode:
        return
    if "No module named pip" in done.stderr:
        raise TaskRpcError(
            "this Python has no pip to download the wheels; install it:"
            f" {sys.executable} -m ensurepip"
        )
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR: ")]
    reason = (errors or done.stderr.splitlines() or ["pip gave no reason"])[-1]
    raise TaskRpcError(
        f"{what}: pip failed ({reason.removeprefix('ERROR: ')});"
        " this computer needs the internet to make the folder, the laptops do not"
    )


def _how_to_install(wheel: Path, pythons: Sequence[str]) -> str:
    version = wheel.name.split("-")[1]
    return _TEXT.format(version=version, first=pythons[0], pythons=", ".join(pythons))


_TEXT = """\
taskrpc {version}: how to install it without the internet

You need Python on Windows (64 bit), macOS or Linux, in one of these versions: {pythons}.
Use this folder where it is, on the stick, or copy it to your computer first.


Windows

Open this folder in the Explorer, type cmd into the address bar and press Enter. In the window:

    py -m venv "%USERPROFILE%\\taskrpc"
    "%USERPROFILE%\\taskrpc\\Scripts\\pip" install --no-index --find-links . taskrpc
    "%USERPROFILE%\\taskrpc\\Scripts\\activate"
    taskrpc demo

In each new window, type the third line again.


macOS and Linux

Open a terminal and go to this folder: type cd and a space, drag the folder into the window, press
Enter. Then:

    python3 -m venv ~/taskrpc
    ~/taskrpc/bin/pip install --no-index --find-links . taskrpc
    . ~/taskrpc/bin/activate
    taskrpc demo

In each new terminal, type the third line again.


In class

The lecturer gives you a line that begins with: taskrpc join


If it does not work

"No matching distribution found": this Python is not one of the versions above. Type py --version
(Windows) or python3 --version to see which it is.
"No module named venv" (Debian, Ubuntu): sudo apt install python3-venv
"""
