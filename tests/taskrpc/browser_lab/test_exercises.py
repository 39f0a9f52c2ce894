"""What the page of the labs shows of each lab."""

from __future__ import annotations

from taskrpc.browser_lab import exercises


def test_folder_that_pip_adds_is_no_file_of_a_lab(tmp_path, monkeypatch):
    lab = tmp_path / "async_files" / "lab1"
    (lab / "__pycache__").mkdir(parents=True)
    (lab / "client.py").write_text("client", encoding="utf-8")
    (lab / "server.py").write_text("server", encoding="utf-8")
    monkeypatch.setattr(exercises.resources, "files", lambda package: tmp_path)
    assert list(exercises._async_files(1)) == ["server.py", "client.py"]
