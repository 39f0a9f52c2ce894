"""Archives come from a folder or the cache; a wrong one is refused; unpacking stays in memory."""

import hashlib
import io
import tarfile

import pytest

from taskrpc import TaskRpcError
from taskrpc.core.system import folders
from taskrpc.course.browser_lab import downloads
from taskrpc.course.browser_lab.downloads import RUNTIME, Archive, runtime


def tar(files):
    data = io.BytesIO()
    with tarfile.open(fileobj=data, mode="w:gz") as made:
        for name, content in files.items():
            member = tarfile.TarInfo(name)
            member.size = len(content)
            made.addfile(member, io.BytesIO(content))
    return data.getvalue()


CONTENTS = {
    "https://npm.example/pyodide-1.tgz": tar(
        {
            **{f"package/{name}": name.encode() for name in downloads._PYODIDE_FILES},
            "package/../../escape": b"outside",
        }
    ),
    "https://pypi.example/msgspec-1.whl": b"a wheel",
    "https://pypi.example/pyyaml-6.0.3.tar.gz": tar({"pyyaml-6.0.3/lib/yaml/__init__.py": b"1"}),
}
ARCHIVES = [
    Archive(url, len(data), hashlib.sha256(data).hexdigest()) for url, data in CONTENTS.items()
]


@pytest.fixture(autouse=True)
def small_archives(monkeypatch, tmp_path):
    for name, archive in zip(("PYODIDE", "MSGSPEC", "PYYAML"), ARCHIVES, strict=True):
        monkeypatch.setattr(downloads, name, archive)
    monkeypatch.setattr(downloads, "ARCHIVES", tuple(ARCHIVES))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_archives_are_downloaded_once_and_unpacked():
    fetched, lines = [], []

    def fetch(archive):
        fetched.append(archive.name)
        return CONTENTS[archive.url]

    first = runtime(None, lines.append, fetch)
    assert set(first) == set(RUNTIME)
    assert first["pyodide/pyodide.mjs"] == b"pyodide.mjs"
    assert len(lines) == len(fetched) == 3
    assert runtime(None, lines.append, fetch) == first
    assert len(fetched) == 3


def test_a_damaged_archive_of_the_cache_is_downloaded_again():
    runtime(None, print, lambda archive: CONTENTS[archive.url])
    (folders.cache_dir() / "msgspec-1.whl").write_bytes(b"half")
    fetched = []
    runtime(None, print, lambda archive: fetched.append(archive.name) or CONTENTS[archive.url])
    assert fetched == ["msgspec-1.whl"]


def test_another_archive_than_the_pinned_one_is_refused():
    with pytest.raises(TaskRpcError, match=r"pyodide-1\.tgz: expected the \d+ bytes with the SHA"):
        runtime(None, print, lambda _: b"another one")
    assert list(folders.cache_dir().iterdir()) == []


def test_without_the_internet_one_line_names_the_way_out():
    def fetch(_):
        raise OSError("no route to host")

    with pytest.raises(TaskRpcError, match=r"no route to host.*--pyodide FOLDER") as caught:
        runtime(None, print, fetch)
    assert "\n" not in str(caught.value)


def test_a_folder_has_the_archives_or_a_written_page(tmp_path):
    for archive in ARCHIVES:
        (tmp_path / archive.name).write_bytes(CONTENTS[archive.url])
    files = runtime(tmp_path, print)
    for name, data in files.items():
        path = tmp_path / "page" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    assert runtime(tmp_path / "page", print) == files
    with pytest.raises(TaskRpcError, match="expected the page of a classroom bundle"):
        runtime(tmp_path / "nothing", print)
