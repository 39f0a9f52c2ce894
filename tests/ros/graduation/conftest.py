"""Runs `taskrpc graduate` on the text of a program."""

import pytest

from taskrpc.cli.main import main


@pytest.fixture
def graduate(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)

    def graduate(text, name="program.py"):
        """The lines that the command prints; none if it finds nothing."""
        (tmp_path / name).write_text(text)
        code = main(["graduate", name])
        printed = capsys.readouterr()
        assert printed.err == ""
        lines = printed.out.splitlines()
        assert code == (0 if lines[0].startswith("found nothing") else 1)
        return [] if code == 0 else lines

    return graduate
