"""The command that installs an extra's packages uses this Python, and never names taskrpc."""

import shlex
import sys
from importlib import metadata

import pytest

from taskrpc.core.security import installing
from taskrpc.core.security.installing import install_command

EXTRAS = [
    ("record", "mcap"),
    ("zenoh", "eclipse-zenoh"),
    ("postgres", "psycopg"),
    ("web", "aiohttp"),
]

posix = pytest.mark.skipif(sys.platform == "win32", reason="the quotes of POSIX shells")


@pytest.mark.parametrize(("extra", "package"), EXTRAS)
def test_command_names_this_python_and_the_package_but_never_taskrpc(extra, package):
    line = install_command(extra, package)
    assert package in line
    words = line.replace(sys.executable, "PYTHON").split()
    assert words[:4] == ["PYTHON", "-m", "pip", "install"]
    assert not any("taskrpc" in each for each in words)


@posix
def test_words_arrive_whole_in_a_shell(monkeypatch):
    monkeypatch.setattr(sys, "executable", "/home/ana b/bin/python")
    monkeypatch.setattr(metadata, "requires", lambda name: ['psycopg[binary]>=3.2; extra == "p"'])
    expected = ["/home/ana b/bin/python", "-m", "pip", "install", "psycopg[binary]>=3.2"]
    assert shlex.split(install_command("p", "psycopg")) == expected


def test_requirement_of_another_extra_or_of_taskrpc_itself_is_not_installed(monkeypatch):
    lines = ['mcap>=1.2; extra == "record"', "rich>=13", 'taskrpc[record]; extra == "all"']
    monkeypatch.setattr(metadata, "requires", lambda name: lines)
    assert installing._requirements("record") == ["mcap>=1.2"]


def test_installation_without_metadata_gets_the_name_of_the_package(monkeypatch):
    def missing(name):
        raise metadata.PackageNotFoundError(name)

    monkeypatch.setattr(metadata, "requires", missing)
    assert install_command("record", "mcap").endswith("-m pip install mcap")


@posix
def test_environments_of_uv_and_pipx_use_their_programs(monkeypatch):
    monkeypatch.setattr(metadata, "requires", lambda name: None)
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    monkeypatch.setattr(sys, "executable", "/x/bin/python")
    assert install_command("a", "mcap") == "uv pip install --python /x/bin/python mcap"
    monkeypatch.setattr(sys, "prefix", "/home/ana/.local/share/pipx/venvs/course")
    assert install_command("a", "mcap") == "pipx inject course mcap"


def test_windows_quotes_blanks_and_says_what_powershell_needs(monkeypatch):
    monkeypatch.setattr(sys, "platform", "win32")
    assert installing._quoted(["C:\\py\\python.exe", "mcap>=1"]) == 'C:\\py\\python.exe "mcap>=1"'
    assert installing._quoted(["C:\\a b\\python.exe", "mcap"]) == (
        '"C:\\a b\\python.exe" mcap (PowerShell: & "C:\\a b\\python.exe" mcap)'
    )
