"""The bundle for a class: a folder with all that students install and read without the internet."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Final

import msgspec

from taskrpc.course.browser_lab.site import add_to_bundle
from taskrpc.course.classroom.bundle_pages import START, Contents, pages
from taskrpc.course.classroom.checksums import check_sums, remove_wrong, write_sums
from taskrpc.course.classroom.wheels import Pip, Wanted, check, download, source
from taskrpc.errors import TaskRpcError

WHEELS: Final = "wheels"
"""The folder of the wheels in a bundle."""
_DOCS, _LABS, _NOTEBOOKS = "docs", "labs", "notebooks"
_ABOUT = "bundle.json"

_MB = 1_000_000
_SET_MB, _SET_WITH_JUPYTER_MB = 8, 18
"""Megabytes for each set of wheels, rounded up: one system with one version of Python."""
_REST_MB = 40
"""Megabytes for documentation, labs and the browser lab."""

Report = Callable[[str], object]
"""Is called with one line for each step."""


class _About(msgspec.Struct):
    """What a bundle was made for, so that it can be checked."""

    version: str
    systems: list[str]
    pythons: list[str]
    jupyter: bool


def make_bundle(
    folder: Path,
    wanted: Wanted,
    report: Report,
    *,
    pip: Pip | None = None,
    browser_lab: Callable[[Path, Report], Path] = add_to_bundle,
) -> list[str]:
    """Fill a folder with wheels, pages, documentation, labs and notebooks.

    Returns a sentence for each part that is missing, but that students can do without.

    Raises:
        TaskRpcError: the folder cannot be written or is too small, or a wheel cannot be made or
            downloaded; the folder is not complete.
    """
    missing: list[str] = []
    try:
        _check_folder(folder, wanted)
        wheels = folder / WHEELS
        wheels.mkdir(exist_ok=True)
        remove_wrong(wheels)
        own = download(wheels, wanted, report, pip)
        write_sums(wheels)
        report("documentation, labs and notebooks")
        docs, sheets, notebooks = _copy_documents(folder, source(), missing)
        lab = _browser_lab(folder, report, browser_lab, missing)
        version = own.name.split("-")[1]
        contents = Contents(
            version=version,
            systems=wanted.systems,
            pythons=wanted.pythons,
            requirements=wanted.requirements,
            pip=next((path.name for path in sorted(wheels.glob("pip-*.whl"))), "pip"),
            docs=docs,
            sheets=sheets,
            notebooks=notebooks,
            browser_lab=lab,
        )
        for name, text in pages(contents).items():
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
        about = _About(version, [*wanted.systems], [*wanted.pythons], wanted.jupyter)
        (folder / _ABOUT).write_bytes(msgspec.json.encode(about))
    except OSError as error:
        raise TaskRpcError(f"{error.filename or folder}: {error.strerror or error}") from None
    return missing


def check_bundle(folder: Path, report: Report, pip: Pip | None = None) -> int:
    """Check that each laptop can install a bundle's wheels; returns the number of sets of wheels.

    Raises TaskRpcError with the first problem.
    """
    try:
        about = msgspec.json.decode((folder / _ABOUT).read_bytes(), type=_About)
    except (OSError, msgspec.MsgspecError):
        how = "`taskrpc classroom bundle DIR` makes one"
        raise TaskRpcError(f"{folder}: expected a complete bundle, found none; {how}") from None
    wanted = Wanted(about.systems, about.pythons, jupyter=about.jupyter)
    if not (folder / START).is_file():
        raise TaskRpcError(f"{folder / START} is missing; make the bundle again")
    report("that no wheel has changed")
    check_sums(folder / WHEELS)
    check(folder / WHEELS, wanted, report, pip)
    return len([*wanted.sets()])


def _check_folder(folder: Path, wanted: Wanted) -> None:
    """Create the folder. Raises TaskRpcError if it cannot be written or is too small."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".taskrpc-writable"
        probe.touch()
        probe.unlink()
    except FileExistsError:
        raise TaskRpcError(f"{folder}: expected a folder, found a file") from None
    except OSError as error:
        raise TaskRpcError(
            f"{folder} cannot be written ({error.strerror}): is the stick write-protected, or does"
            " the folder belong to another user?"
        ) from None
    each = _SET_WITH_JUPYTER_MB if wanted.jupyter else _SET_MB
    needed = _REST_MB + each * len([*wanted.sets()])
    free = shutil.disk_usage(folder).free // _MB
    used = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file()) // _MB
    if free + used < needed:  # a bundle that is made again replaces its files
        raise TaskRpcError(
            f"{folder} has {free} MB free, and the bundle needs {needed} MB: use a larger stick, or"
            " fewer versions with --python and --system"
        )


def _copy_documents(
    folder: Path, root: Path | None, missing: list[str]
) -> tuple[str, dict[int, str], str]:
    """Copy documentation, sheets and notebooks of a checkout.

    Returns the documentation's first page, the sheet of each lab, and the folder of the notebooks.
    """
    if root is None:
        missing.append(
            "documentation, lab sheets and notebooks: an installed taskrpc does not contain them;"
            " run this command from a source checkout"
        )
        return "", {}, ""
    site, docs = root / "build" / "site", folder / _DOCS
    shutil.rmtree(docs, ignore_errors=True)
    if (site / "index.html").is_file():
        shutil.copytree(site, docs)
        first = f"{_DOCS}/index.html"
    else:
        shutil.copytree(root / "docs", docs, ignore=shutil.ignore_patterns("*.py", "site"))
        first = f"{_DOCS}/README.md"
        missing.append("documentation as web pages: it is there as Markdown; `make site` first")
    notebooks = root / "docs" / "teach" / "notebooks"
    if not any(notebooks.glob("*.ipynb")):
        return first, _sheets(folder), ""
    shutil.copytree(notebooks, folder / _NOTEBOOKS, dirs_exist_ok=True)
    return first, _sheets(folder), _NOTEBOOKS


def _sheets(folder: Path) -> dict[int, str]:
    """Return the path of each lab's sheet in the documentation of a bundle."""
    found: dict[int, str] = {}
    for path in sorted((folder / _DOCS).rglob("*")):
        name = path.relative_to(folder).as_posix()
        if match := re.search(r"/teach/lab-(\d+)(\.html|\.md|/index\.html)\Z", name):
            found.setdefault(int(match[1]), name)
    return found


def _browser_lab(
    folder: Path, report: Report, make: Callable[[Path, Report], Path], missing: list[str]
) -> str:
    try:
        return make(folder, report).name
    except TaskRpcError as error:
        missing.append(f"the labs in the browser: {error}")
        return ""
