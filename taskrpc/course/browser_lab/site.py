"""The files of the page: its own, taskrpc, Pyodide, and the labs.

They need no server of ours: any static web server can serve the folder that `write_site` writes.
"""

from __future__ import annotations

import io
import zipfile
from collections.abc import Iterator, Mapping
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path

import msgspec

from taskrpc.course.browser_lab.downloads import Report, runtime
from taskrpc.course.browser_lab.exercises import exercises
from taskrpc.errors import TaskRpcError

FOLDER = "browser-lab"
"""The name of the page's folder in a classroom bundle."""

_OF_THE_LIVE_PAGE = (
    "dom.js",
    "map.js",
    "model.js",
    "style.css",
    "theme.css",
    "theme.js",
    "words.js",
)
# No program of the tab uses these packages; without them, the page loads sooner.
_LEFT_OUT = (
    "taskrpc/cli/",
    "taskrpc/ros/colcon/",
    "taskrpc/ros/graduation/",
    "taskrpc/course/notebook/",
    "taskrpc/course/browser_lab/static/",
    "taskrpc/simulation/run/",
    "taskrpc/simulation/search/",
)


def site_files(parts: Mapping[str, bytes], variant: str = "") -> dict[str, bytes]:
    """Return all files of the page, by their paths.

    Args:
        parts: the files of Pyodide; see `downloads.runtime`.
        variant: the ID of the variant that the starter files have.
    """
    static = resources.files("taskrpc.course.browser_lab") / "static"
    live = resources.files("taskrpc.observe.web") / "static"
    return {
        **{file.name: file.read_bytes() for file in static.iterdir() if file.is_file()},
        **{name: (live / name).read_bytes() for name in _OF_THE_LIVE_PAGE},
        "labs.json": msgspec.json.encode({"labs": exercises(variant)}),
        "taskrpc.zip": own_archive(),
        **parts,
    }


def write_site(folder: Path, files: Mapping[str, bytes]) -> None:
    """Write the page into a folder. Raises TaskRpcError."""
    try:
        for name, data in files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(data)
    except OSError as error:
        raise TaskRpcError(f"{error.filename or folder}: {error.strerror or error}") from None


def add_to_bundle(bundle: Path, report: Report) -> Path:
    """Write the page into a classroom bundle, downloading Pyodide if necessary; returns its folder.

    Raises TaskRpcError.
    """
    report("the labs in the browser")
    folder = bundle / FOLDER
    write_site(folder, site_files(runtime(None, report)))
    return folder


def own_archive() -> bytes:
    """Return the modules of srvgen and taskrpc, with their data, as a zip archive."""
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as archive:
        for package in ("srvgen", "taskrpc"):
            for name, content in sorted(_files(resources.files(package), f"{package}/")):
                archive.writestr(zipfile.ZipInfo(name), content, zipfile.ZIP_DEFLATED)
    return data.getvalue()


def _files(folder: Traversable, prefix: str) -> Iterator[tuple[str, bytes]]:
    if prefix in _LEFT_OUT:
        return
    for entry in folder.iterdir():
        name = prefix + entry.name
        if entry.is_dir():
            if entry.name not in ("__pycache__", "public_interfaces"):
                yield from _files(entry, f"{name}/")
        else:
            yield name, entry.read_bytes()
