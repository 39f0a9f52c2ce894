"""Command lines as texts."""

import sys

import pytest

from taskrpc.ros.command_line import split_words, startable


def test_words_are_those_of_a_shell():
    assert split_words("ros2 param set /sim 'a b' \"{x: 1, name: ''}\" #1") == [
        *("ros2", "param", "set", "/sim", "a b", "{x: 1, name: ''}", "#1")
    ]
    with pytest.raises(ValueError, match="closing quotation"):
        split_words("it's")


def test_backslash_separates_folders_on_windows():
    assert split_words(r"C:\a\b.exe") == (
        [r"C:\a\b.exe"] if sys.platform == "win32" else ["C:ab.exe"]
    )


def test_program_is_found_as_the_shell_finds_it(tmp_path):
    (tmp_path / "tool.cmd").write_text("@echo off\n")
    found = startable(["tool", "a"], {"PATH": str(tmp_path)})
    if sys.platform == "win32":
        assert [each.lower() for each in found] == [str(tmp_path / "tool.cmd").lower(), "a"]
    else:
        assert found == ["tool", "a"]
    assert startable([], None) == []
