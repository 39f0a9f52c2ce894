"""Private files and folders are closed to other users, and links to others' files are refused."""

import os
import stat
import subprocess
import sys

import pytest

import taskrpc
from taskrpc.core.system import private_files

posix = pytest.mark.skipif(os.name != "posix", reason="modes and owners are POSIX's")


@posix
def test_private_folder_is_closed_to_other_users_with_any_umask(tmp_path):
    before = os.umask(0)
    try:
        assert stat.S_IMODE(private_files.private_dir(tmp_path / "a").stat().st_mode) == 0o700
        (tmp_path / "b").mkdir(mode=0o777)
        assert stat.S_IMODE(private_files.private_dir(tmp_path / "b").stat().st_mode) == 0o700
        descriptor = private_files.open_private(tmp_path / "f")
        assert stat.S_IMODE(os.fstat(descriptor).st_mode) == 0o600
        os.close(descriptor)
    finally:
        os.umask(before)


@posix
def test_owners_and_open_folders_are_recognised(tmp_path, monkeypatch):
    tmp_path.chmod(0o755)
    assert not private_files.is_writable_by_all(tmp_path)
    tmp_path.chmod(0o1777)
    assert private_files.is_writable_by_all(tmp_path)
    assert not private_files.is_writable_by_all(tmp_path / "missing")
    tmp_path.chmod(0o700)
    found = tmp_path.stat()
    assert private_files.is_ours_or_roots(found)
    monkeypatch.setattr(os, "getuid", lambda: found.st_uid + 1)
    assert private_files.is_ours_or_roots(found) == (found.st_uid == 0)
    changed = list(found)
    changed[4] = found.st_uid + 7
    assert not private_files.is_ours_or_roots(os.stat_result(changed))


@posix
def test_folder_of_another_user_or_a_file_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    (tmp_path / "target").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "target")
    for name in ("file", "link", "file/below"):
        with pytest.raises(taskrpc.TaskRpcError, match="folder"):
            private_files.private_dir(tmp_path / name)
    (tmp_path / "to").symlink_to(tmp_path / "file")
    with pytest.raises(OSError, match=r"[Ss]ymbolic|[Ll]ink|ELOOP"):
        private_files.open_private(tmp_path / "to")


@pytest.mark.skipif(sys.platform == "win32", reason="file modes are POSIX's")
def test_private_file_is_private_from_its_first_byte_also_in_place_of_another(tmp_path):
    path = tmp_path / "secret"
    waiting = tmp_path / f"secret.{os.getpid()}.new"
    waiting.write_text("another program's")
    waiting.chmod(0o666)
    others = os.open(waiting, os.O_RDONLY)
    modes = []
    fsync = os.fsync

    def look(descriptor):
        modes.append(stat.S_IMODE(os.fstat(descriptor).st_mode))
        fsync(descriptor)

    before = os.umask(0)
    try:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(os, "fsync", look)
            private_files.write_private(path, b"the secret")
    finally:
        os.umask(before)
    assert modes == [0o600]
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert os.read(others, 100) == b"another program's"
    os.close(others)


@posix
def test_private_file_stays_in_the_opened_folder_if_another_takes_its_place(tmp_path, monkeypatch):
    """As a user can do who may write to the folder above."""
    own, away, other = (tmp_path / name for name in ("own", "away", "other"))
    own.mkdir()
    other.mkdir()
    new = other / f"file.{os.getpid()}.new"
    new.write_bytes(b"another's")

    def replace(_):
        own.rename(away)
        own.symlink_to(other)

    monkeypatch.setattr(os, "fsync", replace)
    private_files.write_private(own / "file", b"the secret")
    assert new.read_bytes() == b"another's"
    assert [(each.name, each.read_bytes()) for each in away.iterdir()] == [("file", b"the secret")]


@posix
def test_mode_of_a_links_target_is_not_set(tmp_path):
    file, link = tmp_path / "file", tmp_path / "link"
    file.touch(0o644)
    link.symlink_to(file)
    if sys.platform == "linux":  # macOS sets the mode of the link itself
        with pytest.raises(OSError, match="symbolic links"):
            private_files.set_mode(link, 0o600)
    assert stat.S_IMODE(file.stat().st_mode) == 0o644
    private_files.set_mode(file, 0o600)
    assert stat.S_IMODE(file.stat().st_mode) == 0o600


@posix
def test_setting_a_mode_keeps_the_locks_of_a_file(tmp_path):
    file = tmp_path / "file"
    look = (
        "import fcntl; f = open('file', 'r+')\n"
        "try: fcntl.lockf(f, fcntl.LOCK_EX | fcntl.LOCK_NB); print('free')\n"
        "except OSError: print('locked')"
    )
    with file.open("w") as held:
        import fcntl

        fcntl.lockf(held, fcntl.LOCK_EX)
        private_files.set_mode(file, 0o600)
        seen = subprocess.run([sys.executable, "-c", look], cwd=tmp_path, capture_output=True)
    assert seen.stdout == b"locked\n"
