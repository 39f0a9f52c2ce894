"""`taskrpc classroom bundle` on the command line."""

from __future__ import annotations

import pytest

from taskrpc.cli.course.classroom import offline
from taskrpc.cli.main import main
from taskrpc.course.classroom import bundle


@pytest.fixture
def made(monkeypatch):
    """The wanted sets of the bundles that were made."""
    found = []

    def make(folder, wanted, report):
        found.append(wanted)
        report("Windows, Python 3.12")
        (folder / "file").write_bytes(bytes(3_000_000))
        return ["documentation: why"]

    monkeypatch.setattr(offline, "make_bundle", make)
    return found


def test_bundle_prints_steps_what_is_left_out_and_the_size(tmp_path, made, capsys):
    options = ["--python", "3.12", "--system", "windows", "--jupyter"]
    assert main(["classroom", "bundle", str(tmp_path), *options]) == 0
    shown = capsys.readouterr()
    assert shown.err.splitlines() == [
        "getting Windows, Python 3.12 ...",
        "left out: documentation: why",
    ]
    start = tmp_path / "START-HERE.html"
    assert shown.out == f"{tmp_path} is ready (3 MB); students begin with {start}\n"
    (wanted,) = made
    assert (wanted.systems, wanted.pythons, wanted.jupyter) == (("windows",), ("3.12",), True)


def test_bundle_is_for_all_systems_and_pythons_by_default(tmp_path, made):
    assert main(["classroom", "bundle", str(tmp_path)]) == 0
    assert made[0].systems == ("windows", "macos", "linux")
    assert made[0].pythons == ("3.11", "3.12", "3.13", "3.14")
    assert not made[0].jupyter


def test_interrupted_bundle_says_that_the_same_command_continues(tmp_path, monkeypatch, capsys):
    def make(folder, wanted, report):
        raise KeyboardInterrupt

    monkeypatch.setattr(offline, "make_bundle", make)
    assert main(["classroom", "bundle", str(tmp_path)]) == 130
    assert capsys.readouterr().err == (
        f"{tmp_path} is not complete; the same command continues, and keeps what is there\n"
    )


@pytest.mark.parametrize("version", ["3", "3.9", "4.0", "3.12.1", "x"])
def test_invalid_python_version_is_wrong_usage(tmp_path, capsys, version):
    assert main(["classroom", "bundle", str(tmp_path), "--python", version]) == 2
    assert f"expected a version such as 3.12, got '{version}'" in capsys.readouterr().err


def test_check_prints_the_number_of_combinations(tmp_path, monkeypatch, capsys):
    def check(folder, report):
        report("Linux, Python 3.12")
        return 20

    monkeypatch.setattr(offline, "check_bundle", check)
    assert main(["classroom", "bundle", "--check", str(tmp_path)]) == 0
    shown = capsys.readouterr()
    assert shown.err == "checking Linux, Python 3.12 ...\n"
    assert shown.out == (
        f"{tmp_path} is complete: 20 combinations of system and Python can install it\n"
    )


def test_check_takes_no_other_option(tmp_path, capsys):
    assert main(["classroom", "bundle", "--check", str(tmp_path), "--jupyter"]) == 2
    assert "--check checks all that is in the folder" in capsys.readouterr().err


def test_check_of_a_folder_without_a_bundle_is_one_line(tmp_path, capsys):
    assert main(["classroom", "bundle", "--check", str(tmp_path)]) == 1
    assert capsys.readouterr().err == (
        f"{tmp_path}: expected a complete bundle, found none;"
        " `taskrpc classroom bundle DIR` makes one\n"
    )


def test_place_that_cannot_be_written_is_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(bundle, "download", lambda *_: pytest.fail("downloaded"))
    place = tmp_path / "stick"
    place.touch()
    assert main(["classroom", "bundle", str(place)]) == 1
    assert capsys.readouterr().err == f"{place}: expected a folder, found a file\n"


def test_classroom_command_names_the_bundle_command(capsys):
    assert main(["classroom", "--address", "192.0.2.7"]) == 0
    assert "for laptops without taskrpc: taskrpc classroom bundle DIR\n" in capsys.readouterr().err
