"""The wheels of the offline installation: taskrpc's own one and its dependencies."""

from __future__ import annotations

import base64
import hashlib
import subprocess
import sys
import tempfile
import tomllib
import zipfile
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from importlib import metadata
from pathlib import Path

from taskrpc.errors import TaskRpcError

PYTHONS = ("3.11", "3.12", "3.13", "3.14")
"""Versions of Python on the laptops."""

SYSTEMS: Mapping[str, Mapping[str, Sequence[str]]] = {
    "windows": {"Windows": ("win_amd64",)},
    "macos": {
        "macOS (Apple silicon)": ("macosx_11_0_arm64",),
        "macOS (Intel)": ("macosx_11_0_x86_64",),
    },
    "linux": {
        "Linux": ("manylinux_2_28_x86_64", "manylinux_2_17_x86_64", "manylinux2014_x86_64"),
        "Linux (ARM)": (
            "manylinux_2_28_aarch64",
            "manylinux_2_17_aarch64",
            "manylinux2014_aarch64",
        ),
    },
}
"""Systems of the laptops, their machines, and the tags that pip knows for the wheels of each."""

EXTRAS = "completion,simulate,tls,web"
"""The extras that students and lecturers need."""

JUPYTER = "notebook"
"""The package that runs the notebooks."""

_PACKAGE = "taskrpc"
_TAG = "py3-none-any"
# The installer writes these files; they describe one installation.
_NOT_IN_A_WHEEL = {"RECORD", "INSTALLER", "REQUESTED", "direct_url.json"}

_FULL = ("No space left on device", "not enough space on the disk")
"""What Linux and macOS, and what Windows say about a full disk."""

Pip = Callable[[Sequence[str], str], None]
"""Runs pip with arguments; the text names the purpose in errors. Raises TaskRpcError."""


class Wanted:
    """What the laptops of a class need: their systems, versions of Python, and Jupyter or not."""

    def __init__(
        self,
        systems: Sequence[str] = tuple(SYSTEMS),
        pythons: Sequence[str] = PYTHONS,
        *,
        jupyter: bool = False,
    ) -> None:
        self.systems = tuple(system for system in SYSTEMS if system in systems)
        """Keys of `SYSTEMS`."""
        self.pythons = tuple(dict.fromkeys(pythons))
        self.jupyter = jupyter

    def sets(self) -> Iterator[tuple[str, list[str]]]:
        """Yield each set of wheels: its name, and pip's options for it."""
        for system in self.systems:
            for machine, tags in SYSTEMS[system].items():
                platforms = [part for tag in tags for part in ("--platform", tag)]
                for python in self.pythons:
                    options = ["--only-binary=:all:", *platforms, "--python-version", python]
                    yield f"{machine}, Python {python}", options

    @property
    def requirements(self) -> list[str]:
        """What a laptop installs."""
        return [f"{_PACKAGE}[{EXTRAS}]", *([JUPYTER] if self.jupyter else [])]


def download(
    folder: Path, wanted: Wanted, report: Callable[[str], object], pip: Pip | None = None
) -> Path:
    """Fill a folder with taskrpc's own wheel and its dependencies; returns its own wheel.

    `report` is called with one line for each step. A wheel that is in the folder already, with the
    SHA-256 that the index gives, is not downloaded again: pip checks this.

    Raises:
        TaskRpcError: a wheel cannot be made or downloaded; the folder is not complete.
    """
    pip = pip or run_pip
    report("taskrpc's own wheel")
    wheel = make_own_wheel(folder, pip)
    # The wheel's path, not its name: an index may have another package of this name.
    # pip itself too, because Debian's Python has none without a further package.
    requirements = [f"{wheel}[{EXTRAS}]", *wanted.requirements[1:], "pip"]
    sets = [*wanted.sets()]
    for number, (what, options) in enumerate(sets, 1):
        there = sum(path.stat().st_size for path in folder.glob("*.whl"))
        report(f"{what} ({number} of {len(sets)}; {there / 1e6:.0f} MB are there)")
        pip(["download", "--dest", str(folder), *options, *requirements], what)
    return wheel


def check(
    folder: Path, wanted: Wanted, report: Callable[[str], object], pip: Pip | None = None
) -> None:
    """Check that the wheels of a folder are undamaged, and that each laptop can install them.

    Raises TaskRpcError with the first problem.
    """
    pip = pip or run_pip
    report("that no wheel is damaged")
    for wheel in sorted(folder.glob("*.whl")):
        check_wheel(wheel)
    with tempfile.TemporaryDirectory() as target:
        for what, options in wanted.sets():
            report(what)
            folders = ["--no-index", "--find-links", str(folder), "--target", target]
            pip(["install", "--dry-run", *folders, *options, *wanted.requirements], what)


def check_wheel(path: Path) -> None:
    """Raise TaskRpcError if a wheel cannot be read completely, as after a stick's early removal."""
    try:
        with zipfile.ZipFile(path) as wheel:
            damaged = wheel.testzip() is not None
    except (OSError, zipfile.BadZipFile, zlib.error):
        damaged = True
    if damaged:
        raise TaskRpcError(f"{path} is damaged: delete it, and make the folder again")


def make_own_wheel(folder: Path, pip: Pip) -> Path:
    """Make taskrpc's own wheel: from its source, or else from what is installed.

    Raises TaskRpcError.
    """
    if root := source():
        pip(["wheel", "--no-deps", "--wheel-dir", str(folder), str(root)], "taskrpc's own wheel")
        made = sorted(folder.glob(f"{_PACKAGE}-*.whl"), key=lambda path: path.stat().st_mtime)
        return made[-1]
    try:
        return pack_installed(metadata.distribution(_PACKAGE), folder)
    except metadata.PackageNotFoundError:
        root = Path(__file__).resolve().parents[3]
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


def source() -> Path | None:
    """Return the folder of the source checkout that runs, None for an installed taskrpc."""
    root = Path(__file__).resolve().parents[3]
    try:
        project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError):
        return None
    return root if project.get("project", {}).get("name") == _PACKAGE else None


def run_pip(arguments: Sequence[str], what: str) -> None:
    """Run pip of this Python. Raises TaskRpcError with pip's reason."""
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if not done.returncode:
        return
    if "No module named pip" in done.stderr:
        raise TaskRpcError(
            "this Python has no pip to download the wheels; install it:"
            f" {sys.executable} -m ensurepip"
        )
    if any(text in done.stderr for text in _FULL):
        raise TaskRpcError(f"{what}: no space is left for the files: use a larger stick or disk")
    errors = [line for line in done.stderr.splitlines() if line.startswith("ERROR: ")]
    reason = (errors or done.stderr.splitlines() or ["pip gave no reason"])[-1]
    advice = (
        "this computer needs the internet to make the folder, the laptops do not. Run the command"
        " again: it keeps what is there"
    )
    if arguments[0] == "install":
        advice = "make the folder again with `taskrpc classroom bundle`"
    raise TaskRpcError(f"{what}: pip failed ({reason.removeprefix('ERROR: ')}); {advice}")
