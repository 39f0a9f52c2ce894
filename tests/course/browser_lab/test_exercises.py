"""What the page of the labs shows of each lab."""

from __future__ import annotations

import re

import pytest

from taskrpc.course.browser_lab import exercises
from taskrpc.course.labs.catalogue import lab
from taskrpc.course.labs.variants import Variant


def test_folder_that_pip_adds_is_no_file_of_a_lab(tmp_path, monkeypatch):
    folder = tmp_path / "async_files" / "lab1"
    (folder / "__pycache__").mkdir(parents=True)
    (folder / "client.py").write_text("client", encoding="utf-8")
    (folder / "server.py").write_text("server", encoding="utf-8")
    monkeypatch.setattr(exercises.resources, "files", lambda package: tmp_path)
    assert list(exercises._async_files(lab(1), Variant())) == ["server.py", "client.py"]


@pytest.mark.parametrize("number", [1, 2, 3])
def test_asynchronous_version_has_the_programs_and_the_variant_of_the_lab(number):
    texts = exercises._async_files(lab(number), Variant("ada"))
    assert list(texts) == list(lab(number).files) or number == 2
    assert lab(number).values(Variant("ada"))["SERVICE"] in "".join(texts.values())
    for name, text in texts.items():
        assert not re.search("@[A-Z_]+@", name + text)
        if name.endswith(".py"):
            assert "async def" in text
            compile(text, name, "exec")


def test_asynchronous_version_of_lab_2_has_its_definition():
    names = list(exercises._async_files(lab(2), Variant()))
    assert names[:2] == ["robot_interfaces/srv/RobotTask.srv", "server.py"]
