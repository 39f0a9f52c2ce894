"""The wheels of the bundle: what is downloaded, taskrpc's own wheel, and the check."""

from __future__ import annotations

import base64
import hashlib
import subprocess
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

from taskrpc.course.classroom import wheels
from taskrpc.course.classroom.wheels import (
    PYTHONS,
    SYSTEMS,
    Wanted,
    check,
    check_wheel,
    download,
    pack_installed,
)
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
    pip, said = Pip(), []
    download(tmp_path, Wanted(), said.append, pip)
    (own, _), *downloads = pip.calls
    assert own == "taskrpc's own wheel"
    machines = [machine for each in SYSTEMS.values() for machine in each]
    sets = [f"{machine}, Python {each}" for machine in machines for each in PYTHONS]
    assert [what for what, _ in downloads] == sets
    assert sets[0] == "Windows, Python 3.11"
    for _, arguments in downloads:
        assert arguments[0] == "download"
        assert {"--only-binary=:all:", "--platform", "--python-version", "pip"} <= {*arguments}
        own = f"{tmp_path / WHEEL}[completion,simulate,tls,web]"
        assert own in arguments, "not a name that an index may have too"


def test_progress_counts_the_sets_and_what_is_there(tmp_path):
    said = []

    def pip(arguments, what):
        Pip()(arguments, what)
        if arguments[0] == "download":
            Path(tmp_path, f"{len(said)}.whl").write_bytes(bytes(2_000_000))

    download(tmp_path, Wanted(["macos"], ["3.13"]), said.append, pip)
    assert said == [
        "taskrpc's own wheel",
        "macOS (Apple silicon), Python 3.13 (1 of 2; 0 MB are there)",
        "macOS (Intel), Python 3.13 (2 of 2; 2 MB are there)",
    ]


def test_only_wanted_systems_are_downloaded_and_jupyter_too(tmp_path):
    pip = Pip()
    download(tmp_path, Wanted(["linux", "windows"], ["3.12"], jupyter=True), print, pip)
    machines = ["Windows", "Linux", "Linux (ARM)"]
    assert [what for what, _ in pip.calls[1:]] == [f"{each}, Python 3.12" for each in machines]
    assert all("notebook" in arguments for _, arguments in pip.calls[1:])


def test_check_resolves_each_set_without_an_index(tmp_path):
    pip, said = Pip(), []
    check(tmp_path, Wanted(["macos"], ["3.13"]), said.append, pip)
    assert said == [
        "that no wheel is damaged",
        "macOS (Apple silicon), Python 3.13",
        "macOS (Intel), Python 3.13",
    ]
    for _, arguments in pip.calls:
        assert arguments[:3] == ["install", "--dry-run", "--no-index"]
        assert arguments[-1] == "taskrpc[completion,simulate,tls,web]"


@pytest.mark.parametrize("left", [0, 40, -1])
def test_wheel_of_a_stick_that_was_removed_too_early_is_damaged(tmp_path, left):
    path = tmp_path / WHEEL
    with zipfile.ZipFile(path, "w") as wheel:
        wheel.writestr("taskrpc/__init__.py", "answer = 42")
    check_wheel(path)
    whole = path.read_bytes()
    path.write_bytes(whole[:left] if left >= 0 else whole.replace(b"42", b"43"))
    with pytest.raises(TaskRpcError, match=r"-any\.whl is damaged: delete it, and make the folder"):
        check(tmp_path, Wanted(), print, Pip())


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

    monkeypatch.setattr(wheels, "source", lambda: None)
    monkeypatch.setattr(metadata, "distribution", unknown)
    with pytest.raises(TaskRpcError, match="neither installed nor a source checkout"):
        wheels.make_own_wheel(tmp_path, Pip())


def failing_pip(monkeypatch, stderr):
    done = subprocess.CompletedProcess([], 1, "", stderr)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)


@pytest.mark.parametrize(
    ("verb", "stderr", "message"),
    [
        (
            "download",
            "WARNING: x\nERROR: Could not find a version that satisfies y\nz\n",
            "W: pip failed (Could not find a version that satisfies y);"
            " this computer needs the internet to make the folder, the laptops do not. Run the"
            " command again: it keeps what is there",
        ),
        (
            "download",
            "ERROR: Exception:\nTraceback ...\nOSError: [Errno 28] No space left on device\n",
            "W: no space is left for the files: use a larger stick or disk",
        ),
        (
            "install",
            "ERROR: No matching distribution found for msgspec\n",
            "W: pip failed (No matching distribution found for msgspec); make the folder again with"
            " `taskrpc classroom bundle`",
        ),
        ("download", "", "W: pip failed (pip gave no reason); this computer needs the internet"),
    ],
)
def test_failure_of_pip_is_one_line(monkeypatch, verb, stderr, message):
    failing_pip(monkeypatch, stderr)
    with pytest.raises(TaskRpcError) as raised:
        wheels.run_pip([verb], "W")
    assert str(raised.value).startswith(message)
    assert "\n" not in str(raised.value)


def test_python_without_pip_gets_the_command_that_installs_it(monkeypatch):
    failing_pip(monkeypatch, "/usr/bin/python3: No module named pip\n")
    with pytest.raises(TaskRpcError, match="has no pip to download the wheels; install it: "):
        wheels.run_pip(["download"], "W")
