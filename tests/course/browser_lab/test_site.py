"""The files of the page are complete, and a folder of them needs no other file."""

import io
import re
import zipfile

import pytest

from taskrpc import TaskRpcError
from taskrpc.course.browser_lab import site
from taskrpc.course.browser_lab.exercises import exercises


@pytest.fixture(scope="module")
def files():
    return site.site_files({"pyodide/pyodide.mjs": b""})


def test_each_file_that_a_page_or_module_names_is_there(files):
    for name in ("index.html", *(name for name in files if name.endswith(".js"))):
        text = files[name].decode()
        for found in re.findall(r'(?:from|href=|src=)\s*"\.?/?([\w/]+\.(?:m?js|css))"', text):
            assert found in files, f"{name} needs {found}"


def test_the_archive_has_what_the_worker_imports_and_no_command(files):
    with zipfile.ZipFile(io.BytesIO(files["taskrpc.zip"])) as archive:
        names = set(archive.namelist())
    assert {"srvgen/interfaces.zip", "taskrpc/course/browser_lab/tab/session.py"} <= names
    assert not [name for name in names if name.startswith("taskrpc/cli/") or ".pyc" in name]


def test_a_written_page_can_be_served_from_a_folder(files, tmp_path):
    site.write_site(tmp_path / "page", files)
    assert (tmp_path / "page" / "pyodide" / "pyodide.mjs").is_file()
    (tmp_path / "file").write_text("")
    with pytest.raises(TaskRpcError, match="file"):
        site.write_site(tmp_path / "file", files)


def test_a_bundle_gets_the_page_in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr(site, "runtime", lambda folder, report: {"msgspec.whl": b"wheel"})
    lines = []
    assert site.add_to_bundle(tmp_path, lines.append) == tmp_path / "browser-lab"
    assert (tmp_path / "browser-lab" / "msgspec.whl").read_bytes() == b"wheel"
    assert lines == ["the labs in the browser"]


def test_an_exercise_has_the_starter_files_of_its_variant():
    first = exercises()[0]
    assert first["number"] == 1
    assert [file["name"] for file in first["files"]] == ["server.py", "client.py"]
    assert [file["name"] for file in first["async_files"]] == ["server.py", "client.py"]
    texts = {exercises(name)[0]["files"][0]["text"] for name in ("", "ada", "bob", "eve", "kim")}
    assert len(texts) > 1
