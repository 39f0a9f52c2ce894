"""The command line of a sandbox, and the reasons why there is none."""

import os
import platform
import stat
import subprocess
import sys
from pathlib import Path

import pytest

from taskrpc.course.labs.sandbox import bubblewrap
from tests.labs.confined import needs_bubblewrap


def test_other_systems_have_no_sandbox(monkeypatch):
    monkeypatch.setattr(platform, "system", lambda: "Darwin")
    assert bubblewrap.why_not() == "bubblewrap is a program for Linux"


@needs_bubblewrap
def test_a_missing_program_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    assert bubblewrap.why_not() == "bubblewrap is not installed"


@needs_bubblewrap
@pytest.mark.real_time
def test_a_refused_sandbox_is_told_with_its_reason(monkeypatch, tmp_path):
    program = tmp_path / "bwrap"
    program.write_text(
        "#!/bin/sh\necho 'bwrap: No permissions to create new namespace' >&2; exit 1\n"
    )
    program.chmod(stat.S_IRWXU)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    assert bubblewrap.why_not() == (
        "bubblewrap does not start here: bwrap: No permissions to create new namespace"
    )


@needs_bubblewrap
def test_the_folders_beside_the_packages_are_not_shown(monkeypatch):
    words = bubblewrap.confined(["true"], Path("/place"), {}, 3)
    shown = [target for word, target in zip(words, words[2:], strict=False) if word == "--ro-bind"]
    assert str(Path(bubblewrap.__file__).parents[4]) not in shown
    assert "/" not in shown
    assert "/home" not in shown


@needs_bubblewrap
@pytest.mark.real_time
def test_an_environment_in_a_closed_folder_is_shown(monkeypatch, tmp_path):
    environment = tmp_path / "environment"  # as `mktemp -d` makes it
    (environment / "bin").mkdir(parents=True)
    (environment / "bin" / "tool").write_text("the tool")
    (environment / "link").symlink_to("bin")
    environment.chmod(stat.S_IRWXU)
    monkeypatch.setattr(sys, "prefix", str(environment))
    filter = bubblewrap.filter_descriptor()
    try:
        command = ["/bin/cat", str(environment / "link" / "tool")]
        words = bubblewrap.confined(command, Path(bubblewrap.__file__).parent, {}, filter)
        ended = subprocess.run(words, capture_output=True, pass_fds=(filter,), check=False)
    finally:
        os.close(filter)
    assert (ended.stdout, ended.stderr, ended.returncode) == (b"the tool", b"", 0)
