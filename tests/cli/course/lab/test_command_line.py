"""`taskrpc lab start`."""

import pytest

from taskrpc.cli.main import main
from taskrpc.course.labs.catalogue import LABS


@pytest.mark.parametrize("lab", LABS, ids=lambda lab: f"lab{lab.number}")
def test_start_names_the_files_with_their_folders_and_the_first_one_to_open(
    lab, tmp_path, monkeypatch, capsys
):
    monkeypatch.chdir(tmp_path)
    assert main(["lab", "start", str(lab.number)]) == 0
    *_, files, following = capsys.readouterr().out.splitlines()
    names = files.removeprefix("Your files: ").split()
    assert all((tmp_path / name).is_file() for name in names)
    assert following == f"Try next: open {names[0]}, then run `taskrpc lab check`"
