"""Pyodide and the packages that the tab needs: downloaded once, with pinned digests."""

from __future__ import annotations

import hashlib
import io
import tarfile
import urllib.error
import urllib.request
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path, PurePosixPath
from typing import Final, NamedTuple

from taskrpc.errors import TaskRpcError
from taskrpc.spi import folders, os_errors, private_files

TIMEOUT: Final = 30.0
"""Seconds without data after which a download is given up."""


class Archive(NamedTuple):
    """A file of a package registry."""

    url: str
    size: int
    """Bytes; more are not read."""
    sha256: str

    @property
    def name(self) -> str:
        """The last part of the URL; its name in a folder."""
        return self.url.rpartition("/")[2]


_PYPI = "https://files.pythonhosted.org/packages"

PYODIDE: Final = Archive(
    "https://registry.npmjs.org/pyodide/-/pyodide-314.0.7.tgz",
    6_488_647,
    "66b7949e5a0cba2250b586d7e368bf12fb482800748d182c4618254b685ffaa0",
)
"""CPython 3.14 for browsers; npm's package has all that is needed to run it."""

MSGSPEC: Final = Archive(
    f"{_PYPI}/75/5d/c0e6bdb81a87f6bd56a663a330c271af7670490c80d8d635d9fa21ad1adf"
    "/msgspec-0.22.0-cp314-cp314-pyemscripten_2026_0_wasm32.whl",
    136_814,
    "a66b1766311e42371e509c996c3933b161c7ae0eabdf361af5316dec197e1022",
)

PYYAML: Final = Archive(
    f"{_PYPI}/05/8e/961c0007c59b8dd7729d542c61a4d537767a59645b82a0b521206e1e25c2/pyyaml-6.0.3.tar.gz",
    130_960,
    "d76623373421df22fb4cf8817020cbb7ef15c725b9d5e45f17e189bfc384190f",
)
"""PyPI has no wheel of it for browsers; the part that is written in Python is enough."""

ARCHIVES: Final = (PYODIDE, MSGSPEC, PYYAML)

_PYODIDE_FILES = (
    "pyodide.mjs",
    "pyodide.asm.mjs",
    "pyodide.asm.wasm",
    "pyodide-lock.json",
    "python_stdlib.zip",
)

RUNTIME: Final = (*(f"pyodide/{name}" for name in _PYODIDE_FILES), "msgspec.whl", "yaml.zip")
"""The files of the page that come from the archives."""

Fetch = Callable[[Archive], bytes]
"""Reads an archive from its URL. Raises OSError."""
Report = Callable[[str], object]
"""Is called with one line for each step that takes long."""


def runtime(folder: Path | None, report: Report, fetch: Fetch | None = None) -> dict[str, bytes]:
    """Return the files of `RUNTIME`.

    Args:
        folder: has the archives, or is a page that `site.write_site` has written; None means the
            cache of this user, into which missing archives are downloaded.
        report: is called with the name and size of each file before its download.
        fetch: replaces the download in tests.

    Raises:
        TaskRpcError: an archive is missing, cannot be downloaded, or is another one.
    """
    if folder is not None:
        if all((folder / name).is_file() for name in RUNTIME):
            return {name: (folder / name).read_bytes() for name in RUNTIME}
        return _unpacked({archive: _from_folder(archive, folder) for archive in ARCHIVES})
    cache = folders.cache_dir()
    return _unpacked(
        {archive: _from_cache(archive, cache, report, fetch or _download) for archive in ARCHIVES}
    )


def _from_folder(archive: Archive, folder: Path) -> bytes:
    try:
        data = (folder / archive.name).read_bytes()
    except OSError as error:
        names = ", ".join(each.name for each in ARCHIVES)
        raise TaskRpcError(
            f"{folder}: expected the page of a classroom bundle, or the files {names};"
            f" {archive.name}: {os_errors.reason_of(error)}"
        ) from None
    _check(archive, data, str(folder / archive.name))
    return data


def _from_cache(archive: Archive, cache: Path, report: Report, fetch: Fetch) -> bytes:
    path = cache / archive.name
    try:
        data = path.read_bytes()
        _check(archive, data, str(path))
    except (OSError, TaskRpcError):
        data = _fetched(archive, report, fetch)
        private_files.write_private(path, data)
    return data


def _fetched(archive: Archive, report: Report, fetch: Fetch) -> bytes:
    report(f"{archive.name} ({archive.size / 1e6:.1f} MB)")
    try:
        data = fetch(archive)
    except OSError as error:
        reason = getattr(error, "reason", None) or error
        raise TaskRpcError(
            f"{archive.url} cannot be downloaded ({reason}); the first start needs the internet, or"
            " --pyodide FOLDER with the page of a classroom bundle"
        ) from None
    _check(archive, data, archive.url)
    return data


def _download(archive: Archive) -> bytes:
    with urllib.request.urlopen(archive.url, timeout=TIMEOUT) as response:
        return bytes(response.read(archive.size + 1))


def _check(archive: Archive, data: bytes, source: str) -> None:
    found = hashlib.sha256(data).hexdigest()
    if found != archive.sha256:
        raise TaskRpcError(
            f"{source}: expected the {archive.size} bytes with the SHA-256 digest {archive.sha256},"
            f" got {len(data)} bytes with {found}; delete the file, or use another source"
        )


def _unpacked(archives: Mapping[Archive, bytes]) -> dict[str, bytes]:
    pyodide = _members(archives[PYODIDE], "package")
    return {
        **{f"pyodide/{name}": pyodide[name] for name in _PYODIDE_FILES},
        "msgspec.whl": archives[MSGSPEC],
        "yaml.zip": _zipped(_members(archives[PYYAML], "pyyaml-6.0.3/lib")),
    }


def _members(archive: bytes, folder: str) -> dict[str, bytes]:
    """Return the files below a folder of a tar archive, in memory: nothing is extracted."""
    found = {}
    with tarfile.open(fileobj=io.BytesIO(archive), mode="r:gz") as tar:
        for member in tar:
            path = PurePosixPath(member.name)
            if member.isfile() and path.is_relative_to(folder):
                file = tar.extractfile(member)
                found[str(path.relative_to(folder))] = b"" if file is None else file.read()
    return found


def _zipped(files: Mapping[str, bytes]) -> bytes:
    data = io.BytesIO()
    with zipfile.ZipFile(data, "w", zipfile.ZIP_DEFLATED) as made:
        for name in sorted(files):
            if name.startswith("yaml/") and name.endswith(".py"):
                made.writestr(zipfile.ZipInfo(name), files[name], zipfile.ZIP_DEFLATED)
    return data.getvalue()
