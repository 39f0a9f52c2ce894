"""The offline installation: downloaded wheels, taskrpc's own wheel, and the instructions."""

from __future__ import annotations

import base64
import hashlib
import subprocess
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from taskrpc.classroom import bundle
from taskrpc.classroom.bundle import INSTALL, PYTHONS, SYSTEMS, make_bundle, pack_installed
from taskrpc.cli.main import main
from taskrpc.errors import TaskRpcError

WHEEL = "taskrpc-0.1.0-py3-none-any.whl"


class Pip:
    """Notes how pip is called, and makes taskrpc's own wheel."""

    def __init__(self):
        self.calls = []

    def __call__(self, arguments, what):
        self.calls.append((what, arguments))
        if arguments[0] == "wheel":
            Path(arguments[arguments.index("--wheel-dir") + 1], WHEEL).touch()


def test_wheels_are_downloaded_for_each_system_and_python(tmp_path):
    pip, said, folder = Pip(), [], tmp_path / "stick" / "taskrpc"
    make_bundle(folder, PYTHONS, said.append, pip)
    (own, _), *downloads = pip.calls
    assert own == "taskrpc's own wheel"
    assert [what for what, _ in downloads] == said[1:]
    assert said[1:] == [f"{system}, Python {each}" for system in SYSTEMS for each in PYTHONS]
    assert "Windows, Python 3.11" in said
    for _, arguments in downloads:
        assert arguments[0] == "download"
        assert {"--only-binary=:all:", "--platform", "--python-version"} <= {*arguments}
        assert arguments[-1] == f"{folder / WHEEL}[tls]", "not a name that an index may have too"


def test_the_text_for_students_installs_from_the_folder_alone(tmp_path):
    make_bundle(tmp_path, ["3.12", "3.13"], lambda _: None, Pip())
    text = (tmp_path / INSTALL).read_text(encoding="utf-8")
    assert text.startswith("taskrpc 0.1.0: how to install it without the internet\n")
    assert "in one of these versions: 3.12, 3.13.\n" in text
    assert text.count("install --no-index --find-links . taskrpc\n") == 2
    assert "py -m venv" in text
    assert "python3 -m venv" in text
    assert str(tmp_path) not in text


@pytest.fixture
def installed(tmp_path):
    """An installation as pip leaves it: files of a wheel, and files that the installer made."""
    place = tmp_path / "site-packages"
    about = place / "taskrpc-1.2.dist-info"
    about.mkdir(parents=True)
    (place / "taskrpc" / "__pycache__").mkdir(parents=True)
    files = {
        "taskrpc/__init__.py": "answer = 42\n",
        "taskrpc/__pycache__/__init__.cpython-311.pyc": "code",
        "taskrpc-1.2.dist-info/METADATA": "Metadata-Version: 2.1\nName: taskrpc\nVersion: 1.2\n",
        "taskrpc-1.2.dist-info/WHEEL": (
            "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        ),
        "taskrpc-1.2.dist-info/INSTALLER": "pip\n",
        "taskrpc-1.2.dist-info/direct_url.json": "{}",
    }
    for name, text in files.items():
        (place / name).write_text(text, newline="\n")
    record = [*files, "../bin/taskrpc", "taskrpc-1.2.dist-info/RECORD"]
    (about / "RECORD").write_text("".join(f"{name},,\n" for name in record))
    return metadata.Distribution.at(about)


def test_an_installed_taskrpc_packs_its_own_wheel(installed, tmp_path):
    path = pack_installed(installed, tmp_path)
    assert path.name == "taskrpc-1.2-py3-none-any.whl"
    with zipfile.ZipFile(path) as wheel:
        assert wheel.namelist() == [
            "taskrpc/__init__.py",
            "taskrpc-1.2.dist-info/METADATA",
            "taskrpc-1.2.dist-info/WHEEL",
            "taskrpc-1.2.dist-info/RECORD",
        ]
        digest = base64.urlsafe_b64encode(hashlib.sha256(b"answer = 42\n").digest()).decode()
        first, *_, last = wheel.read("taskrpc-1.2.dist-info/RECORD").decode().splitlines()
    assert first == f"taskrpc/__init__.py,sha256={digest.rstrip('=')},12"
    assert last == "taskrpc-1.2.dist-info/RECORD,,"


def test_package_that_pip_did_not_install_is_refused(tmp_path):
    about = tmp_path / "taskrpc-1.2.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: taskrpc\nVersion: 1.2\n")
    with pytest.raises(TaskRpcError, match=r"pip did not install it.* from a source checkout"):
        pack_installed(metadata.Distribution.at(about), tmp_path)


def test_neither_source_nor_installation_is_refused_with_one_message(tmp_path, monkeypatch):
    def unknown(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(bundle, "_is_source", lambda _: False)
    monkeypatch.setattr(metadata, "distribution", unknown)
    with pytest.raises(TaskRpcError, match="neither installed nor a source checkout"):
        bundle.make_own_wheel(tmp_path, Pip())


def failing_pip(monkeypatch, stderr):
    done = subprocess.CompletedProcess([], 1, "", stderr)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)


def test_failure_of_pip_is_one_line(tmp_path, monkeypatch, capsys):
    failing_pip(monkeypatch, "WARNING: x\nERROR: Could not find a version that satisfies y\nz\n")
    assert main(["classroom", "bundle", str(tmp_path / "stick")]) == 1
    assert capsys.readouterr().err.splitlines() == [
        "getting taskrpc's own wheel ...",
        "taskrpc's own wheel: pip failed (Could not find a version that satisfies y);"
        " this computer needs the internet to make the folder, the laptops do not",
    ]


def test_python_without_pip_gets_the_command_that_installs_it(tmp_path, monkeypatch, capsys):
    failing_pip(monkeypatch, "/usr/bin/python3: No module named pip\n")
    assert main(["classroom", "bundle", str(tmp_path)]) == 1
    assert "has no pip to download the wheels; install it: " in capsys.readouterr().err


def test_file_instead_of_a_folder_is_one_line(tmp_path, capsys):
    place = tmp_path / "stick"
    place.touch()
    assert main(["classroom", "bundle", str(place)]) == 1
    assert capsys.readouterr().err == f"{place}: expected a folder, found a file\n"


@pytest.mark.parametrize("version", ["3", "3.9", "4.0", "3.12.1", "x"])
def test_invalid_python_version_is_wrong_usage(tmp_path, capsys, version):
    assert main(["classroom", "bundle", str(tmp_path), "--python", version]) == 2
    assert f"expected a version such as 3.12, got '{version}'" in capsys.readouterr().err


def test_bundle_command_prints_the_size_of_the_folder(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bundle, "_run_pip", Pip())
    assert main(["classroom", "bundle", str(tmp_path), "--python", "3.12"]) == 0
    how = f"{tmp_path / INSTALL} tells the students how to install taskrpc"
    said = f"{tmp_path} is ready (0 MB); {how}\n"
    assert capsys.readouterr().out == said


def test_classroom_command_names_the_bundle_command(capsys):
    assert main(["classroom", "--address", "192.0.2.7"]) == 0
    assert "for laptops without taskrpc: taskrpc classroom bundle DIR\n" in capsys.readouterr().err
