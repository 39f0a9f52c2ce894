"""Checksums find each wheel that differs from the one that was downloaded."""

import hashlib

import pytest

from taskrpc.course.classroom.checksums import SUMS, check_sums, remove_wrong, write_sums
from taskrpc.errors import TaskRpcError


@pytest.fixture
def wheels(tmp_path):
    (tmp_path / "a-1.whl").write_bytes(b"first")
    (tmp_path / "b-1.whl").write_bytes(b"second")
    write_sums(tmp_path)
    return tmp_path


def test_sums_have_the_format_of_sha256sum(wheels):
    first, second = (hashlib.sha256(each).hexdigest() for each in (b"first", b"second"))
    assert (wheels / SUMS).read_bytes() == f"{first}  a-1.whl\n{second}  b-1.whl\n".encode()
    check_sums(wheels)


def test_changed_missing_and_added_wheels_are_named(wheels):
    (wheels / "a-1.whl").write_bytes(b"First")
    (wheels / "b-1.whl").unlink()
    (wheels / "c-1.whl").touch()
    with pytest.raises(TaskRpcError) as caught:
        check_sums(wheels)
    assert str(caught.value) == (
        f"{wheels}: b-1.whl is missing; c-1.whl was added; a-1.whl has changed;"
        " make the bundle again"
    )


def test_a_source_archive_is_refused_because_pip_would_run_its_code(wheels):
    (wheels / ".DS_Store").touch()  # pip ignores it
    check_sums(wheels)
    (wheels / "a-9.tar.gz").touch()
    with pytest.raises(TaskRpcError, match=r"a-9\.tar\.gz was added"):
        check_sums(wheels)


def test_missing_sums_are_one_line(wheels):
    (wheels / SUMS).unlink()
    with pytest.raises(TaskRpcError, match="SHA256SUMS cannot be read; make the bundle again"):
        check_sums(wheels)


def test_wheels_that_changed_or_were_added_are_removed_before_a_bundle_is_made_again(wheels):
    (wheels / "a-1.whl").write_bytes(b"First")
    (wheels / "c-1.whl").touch()
    remove_wrong(wheels)
    assert [path.name for path in wheels.iterdir()] == ["b-1.whl"]
    (wheels / "a-1.whl").write_bytes(b"downloaded again")
    remove_wrong(wheels)  # after an interruption, there are no checksums
    assert sorted(path.name for path in wheels.iterdir()) == ["a-1.whl", "b-1.whl"]
