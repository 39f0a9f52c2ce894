"""Imports that fail are explained in one line."""

import sys
import types

import pytest

from srvgen import excepthook


def explained(error):
    """Return the text of an error after `explain`, and whether it was explained."""
    return excepthook.explain(error), str(error)


def test_rclpy_in_plain_python_names_the_command(monkeypatch):
    monkeypatch.setattr(sys, "argv", ["folder/talker.py"])
    error = ModuleNotFoundError("No module named 'rclpy'", name="rclpy")
    text = "No module named 'rclpy'; start the program with: taskrpc run talker.py"
    assert explained(error) == (True, text)
    assert explained(error) == (True, text)


@pytest.mark.parametrize(
    "error",
    [
        ImportError("cannot import name 'SimpleQueue' from 'queue' (queue.py)"),
        AttributeError("module 'queue' has no attribute 'SimpleQueue'"),
        ModuleNotFoundError("No module named 'queue.inner'; 'queue' is not a package"),
    ],
)
def test_a_file_of_the_program_that_hides_a_module_of_python_is_named(monkeypatch, tmp_path, error):
    file = str(tmp_path / "queue.py")
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setitem(sys.modules, "queue", types.SimpleNamespace(__file__=file))
    text = f"the file {file} hides Python's own module queue; rename the file"
    assert explained(error) == (True, text)


@pytest.mark.parametrize(
    "error",
    [
        ImportError("cannot import name 'x' from 'queue' (queue.py)"),  # queue is Python's own
        ModuleNotFoundError("No module named 'helper'", name="helper"),
        AttributeError("module 'helper' has no attribute 'x'"),
        KeyError("x"),
        None,
    ],
)
def test_other_errors_stay_as_they_are(error):
    text = str(error)
    assert explained(error) == (False, text)


def test_what_the_program_itself_misspells_in_its_module_is_no_hidden_module(monkeypatch, tmp_path):
    file = tmp_path / "code.py"
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    monkeypatch.setitem(sys.modules, "code", types.SimpleNamespace(__file__=str(file)))
    text = "module 'code' has no attribute 'helpr'"
    program = compile(f"raise AttributeError({text!r})", str(tmp_path / "main.py"), "exec")
    with pytest.raises(AttributeError) as caught:
        exec(program)
    assert explained(caught.value) == (False, text)


def test_a_removed_working_folder_does_not_stop_the_message(monkeypatch, tmp_path, capsys):
    folder = tmp_path / "gone"
    folder.mkdir()
    monkeypatch.chdir(folder)
    folder.rmdir()
    error = ModuleNotFoundError("No module named 'rclpy'", name="rclpy")
    monkeypatch.setattr(sys, "excepthook", sys.__excepthook__)
    excepthook.show_in_one_message()
    with pytest.raises(SystemExit):
        sys.excepthook(type(error), error, None)
    assert "taskrpc run" in capsys.readouterr().err
