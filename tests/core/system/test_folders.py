"""Folders follow the environment, and are the user's alone."""

import os
import stat

import pytest

from taskrpc.core.system import folders

posix = pytest.mark.skipif(os.name != "posix", reason="modes and owners are POSIX's")


def test_folders_follow_the_environment(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path / "r"))
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "s"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "c"))
    assert folders.runtime_dir() == tmp_path / "r" / "taskrpc"
    assert folders.state_dir() == tmp_path / "s" / "taskrpc"
    assert folders.cache_dir() == tmp_path / "c" / "taskrpc"


@posix
def test_without_xdg_the_runtime_folder_is_the_users_in_the_temporary_folder(tmp_path, monkeypatch):
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    folder = folders.runtime_dir()
    assert folder == tmp_path / f"taskrpc-{os.getuid()}"
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700
