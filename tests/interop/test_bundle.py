"""The bundle of a class, made with pip: the oldest and the newest Python install it offline."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from taskrpc.course.classroom.bundle import check_bundle, make_bundle
from taskrpc.course.classroom.wheels import PYTHONS, Wanted

pytestmark = [
    pytest.mark.interop,
    pytest.mark.real_time,
    pytest.mark.skipif(sys.platform != "linux", reason="installs the wheels for Linux"),
]

TIMEOUT = 240.0  # seconds; a loaded machine compiles the modules slowly


def python(version: str) -> str:
    """Return the path of a Python of this machine, "" if it has none of this version."""
    pyenv = sorted((Path.home() / ".pyenv" / "versions").glob(f"{version}.*/bin/python3"))
    for each in [shutil.which(f"python{version}"), *map(str, pyenv)]:
        if each and not subprocess.run([each, "--version"], capture_output=True).returncode:
            return each
    return ""


ALL = [(version, path) for version in PYTHONS if (path := python(version))]
FOUND = dict(ALL[:1] + ALL[-1:])
"""The oldest and the newest Python of this machine, and where they are."""


@pytest.fixture(scope="module")
def stick(tmp_path_factory):
    """A bundle for Linux, in a folder with a space in its name."""
    folder = tmp_path_factory.mktemp("MY STICK") / "taskrpc"
    make_bundle(folder, Wanted(["linux"], [*FOUND]), print, browser_lab=lambda folder, _: folder)
    return folder


def run(*command: object, cwd: Path, home: Path) -> str:
    """Run a command as a student without an index of packages does; returns its output."""
    names = ("PATH", "LANG", "SYSTEMROOT")
    kept = {name: os.environ[name] for name in names if name in os.environ}
    # No index and no configuration of pip: only the stick can have the wheels.
    environment = {
        **kept,
        "HOME": str(home),
        "PIP_CONFIG_FILE": os.devnull,
        "PIP_NO_INDEX": "1",
        "PIP_COMPILE": "no",
    }
    done = subprocess.run(
        [*map(str, command)],
        cwd=cwd,
        env=environment,
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


PACKAGE = "taskrpc[completion,simulate,tls,web]"
INSTALL = ["install", "--no-index", "--find-links", "wheels", PACKAGE]


OWN, OF_THE_STICK = "the pip of this Python", "the pip of the stick"
PIPS = [(version, OWN) for version in [*FOUND][:1]]
PIPS += [(version, OF_THE_STICK) for version in [*FOUND][1:] or FOUND]
"""The oldest Python has the oldest pip, which must do. To make a pip takes most of the time."""


@pytest.mark.parametrize(("version", "pip"), PIPS)
def test_student_installs_from_the_stick_and_starts_a_lab(stick, tmp_path, version, pip):
    place = tmp_path / "taskrpc" / "bin"
    if pip == OWN:
        run(FOUND[version], "-m", "venv", place.parent, cwd=stick, home=tmp_path)
        run(place / "python", "-m", "pip", *INSTALL, cwd=stick, home=tmp_path)
    else:  # as on Debian, whose Python has no pip
        command = [FOUND[version], "-m", "venv", "--without-pip", place.parent]
        run(*command, cwd=stick, home=tmp_path)
        (wheel,) = (stick / "wheels").glob("pip-*.whl")
        page = (stick / "install-linux.html").read_text(encoding="utf-8")
        assert f"~/taskrpc/bin/python wheels/{wheel.name}/pip install" in page
        install = [*INSTALL[:-1], "pip", INSTALL[-1]]
        run(place / "python", Path("wheels", wheel.name, "pip"), *install, cwd=stick, home=tmp_path)
        told = run(place / "python", "-m", "pip", "--version", cwd=stick, home=tmp_path)
        assert version in told
    assert "taskrpc 0" in run(place / "taskrpc", "--version", cwd=tmp_path, home=tmp_path)
    started = run(place / "taskrpc", "lab", "start", 1, cwd=tmp_path, home=tmp_path)
    assert started.startswith("Lab 1: ")
    run(place / "python", "-c", "import aiohttp, argcomplete, cryptography", cwd=stick, home=place)


def test_check_of_the_bundle_finds_a_missing_wheel(stick, tmp_path):
    copy = shutil.copytree(stick, tmp_path / "copy")
    assert check_bundle(copy, print) == 2 * len(FOUND)
    for wheel in (copy / "wheels").glob("msgspec-*aarch64*"):
        wheel.unlink()
    with pytest.raises(Exception, match=r"wheels: msgspec-\S*aarch64\S* is missing"):
        check_bundle(copy, print)
