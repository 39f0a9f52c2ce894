"""The `srvgen` command: what it prints, where, and how it ends."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from srvgen.cli import main


@pytest.fixture(autouse=True)
def workspace(tmp_path, monkeypatch):
    folder = tmp_path / "workspace"
    folder.mkdir()
    monkeypatch.chdir(folder)
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    return folder


def write(name: str, text: str, folder: Path = Path()) -> Path:
    package, kind, bare = name.split("/")
    path = folder / package / kind / f"{bare}.{kind}"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def run(capsys):
    def call(*arguments):
        try:
            code = main([str(one) for one in arguments])
        except SystemExit as end:
            code = end.code
        return code, *capsys.readouterr()

    return call


def test_check_is_content_with_good_definitions(run):
    write("my_msgs/srv/Fetch", "geometry_msgs/Point where\n---\n")
    assert run("check", "my_msgs") == (0, "1 definition, no problems\n", "")


def test_check_reports_every_problem_of_every_file_with_a_caret(run):
    bad = write("my_msgs/msg/Bad", "int a\nint32 B\n")
    lost = write("my_msgs/srv/Lost", "Header header\nBad bad\n---\n")
    code, out, err = run("check", "my_msgs")
    assert (code, out) == (1, "")
    assert err == (
        f"{bad}:1:1: error: expected a built-in type or the name of a message "
        "(letters and digits, with a capital first), got 'int'\n"
        "    int a\n"
        "    ^\n"
        "  hint: did you mean int32?\n"
        f"{bad}:2:7: error: expected the name of a field "
        "(lower-case letters, digits and single underscores, with a letter first), got 'B'\n"
        "    int32 B\n"
        "          ^\n"
        "  hint: did you mean b?\n"
        f"{lost}:1:1: error: package 'my_msgs' has no message 'Header'\n"
        "    Header header\n"
        "    ^\n"
        "  hint: ROS 2 writes std_msgs/Header\n"
    )


def test_a_problem_of_a_whole_file_has_no_line(run):
    path = write("my_msgs/srv/add", "---")
    slip = path.with_name("Sub.srv.txt")
    slip.write_text("---", encoding="utf-8")
    code, _, err = run("check", path, slip)
    assert code == 1
    assert f"{path}: error: expected a type name" in err
    assert f"{slip}: error: expected a file that ends in" in err


def test_check_prints_json_lines_for_programs(run):
    path = write("my_msgs/msg/Bad", "int a\nint b\n")
    code, out, err = run("check", "--json", path)
    assert (code, out) == (1, "")
    first, second = map(json.loads, err.splitlines())
    assert (first["error"], first["line"], second["line"]) == ("DefinitionError", 1, 2)
    assert first["message"].endswith("got 'int'")
    assert first["path"] == str(path)


def test_describe_prints_one_line_an_interface_and_goes_on_after_a_bad_one(run):
    good = write("my_msgs/srv/Fetch", "nowhere_msgs/Thing thing\nfloat32 NAN=nan\n---\n")
    bad = write("my_msgs/msg/Bad", "int a")
    code, out, err = run("describe", bad, good, "gone", "--json")
    assert code == 1
    (line,) = out.splitlines()
    described = json.loads(line)
    assert described["type"] == "my_msgs/srv/Fetch"
    assert described["spec"] == {
        "request": {
            "fields": [
                {
                    "name": "thing",
                    "type": "Thing",
                    "pkg": "nowhere_msgs",
                    "string_upper_bound": None,
                    "is_array": False,
                    "array_size": None,
                    "is_upper_bound": False,
                    "type_string": "nowhere_msgs/Thing",
                    "default": None,
                }
            ],
            "constants": [{"name": "NAN", "type": "float32", "value": {"$float": "nan"}}],
        },
        "response": {"fields": [], "constants": []},
    }
    assert {json.loads(line)["path"] for line in err.splitlines()} == {str(bad), "gone"}


def test_show_and_hash_find_types_on_a_search_path(run, tmp_path):
    write("far_msgs/srv/Fetch", "# Fetches.\nint32 a # one\n---\n", tmp_path / "far")
    assert run("show", "far_msgs/srv/Fetch")[0] == 1
    code, out, _ = run("show", "-I", tmp_path / "far", "far_msgs/Fetch", "--no-comments")
    assert (code, out) == (0, "int32 a\n---\n")
    code, out, _ = run("hash", "-I", tmp_path / "far", "far_msgs/srv/Fetch_Request", "--json")
    assert code == 0
    assert json.loads(out)["type"] == "far_msgs/srv/Fetch_Request"
    assert json.loads(out)["hash"].startswith("RIHS01_")


def test_hash_prints_the_hash_of_ros(run):
    known = "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a"
    assert run("hash", "example_interfaces/srv/AddTwoInts") == (0, f"{known}\n", "")


def test_an_unknown_type_is_one_message_and_exit_1(run):
    code, out, err = run("hash", "example_interface/srv/AddTwoInts")
    assert (code, out) == (1, "")
    first, hint, looked = err.splitlines()
    assert first == "no package 'example_interface' within reach"
    assert hint == "  hint: did you mean example_interfaces?"
    assert looked.startswith(f"  looked in: {Path.cwd()}, ")
    assert looked.endswith(", the packages of srvgen")


@pytest.mark.parametrize(
    "arguments", [[], ["nonsense"], ["fix"], ["generate", "x"], ["check", "-I", "gone", "."]]
)
def test_wrong_usage_is_exit_2(run, arguments):
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("usage: srvgen")


def test_generated_packages_can_be_imported_and_are_then_up_to_date(run, tmp_path):
    write("my_msgs/srv/Fetch", "string what\n---\nbool found\n")
    write("my_msgs/msg/Bad", "int a")
    out = tmp_path / "out"
    assert run("generate", "my_msgs", "-o", out, "--check")[0] == 1
    assert not out.exists()
    assert run("generate", "my_msgs/srv", "-o", out) == (0, "", "")
    assert run("generate", "my_msgs/srv", "-o", out, "--check") == (0, "", "")
    program = "from my_msgs.srv import Fetch; print(Fetch.Request(what='ball'))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=out, capture_output=True, text=True, check=True
    )
    assert done.stdout == "my_msgs.srv.Fetch_Request(what='ball')\n"
    (out / "my_msgs" / "srv" / "_fetch.py").write_text("", encoding="utf-8")
    code, _, err = run("generate", "my_msgs/srv", "-o", out, "--check")
    assert (code, "is not up to date" in err) == (1, True)
    code, _, err = run("generate", "my_msgs", "-o", tmp_path / "others")
    assert (code, "got 'int'" in err) == (1, True)
    assert (tmp_path / "others" / "my_msgs" / "srv" / "_fetch.py").is_file()


def test_a_module_whose_definition_has_gone_is_removed_and_asked_for_by_check(run, tmp_path):
    write("my_msgs/srv/Fetch", "---\n")
    gone = write("my_msgs/srv/Bring", "---\n")
    out = tmp_path / "out"
    assert run("generate", "my_msgs", "-o", out) == (0, "", "")
    gone.unlink()
    module = out / "my_msgs" / "srv" / "_bring.py"
    code, _, err = run("generate", "my_msgs", "-o", out, "--check")
    assert code == 1
    assert f"{module} belongs to no definition any more: run srvgen generate\n" in err
    assert module.exists()
    assert run("generate", "my_msgs", "-o", out) == (0, "", "")
    assert not module.exists()
    assert run("generate", "my_msgs", "-o", out, "--check") == (0, "", "")


def test_a_definition_that_is_broken_just_now_keeps_its_module(run, tmp_path):
    write("my_msgs/srv/Fetch", "---\n")
    broken = write("my_msgs/srv/Bring", "---\n")
    out = tmp_path / "out"
    run("generate", "my_msgs", "-o", out)
    broken.write_text("int a\n---\n", encoding="utf-8")
    assert run("generate", "my_msgs", "-o", out)[0] == 1
    assert (out / "my_msgs" / "srv" / "_bring.py").exists()


def test_a_folder_that_cannot_be_written_is_one_message(run, tmp_path):
    write("my_msgs/srv/Fetch", "---\n")
    (tmp_path / "out").write_text("a file", encoding="utf-8")
    code, out, err = run("generate", "my_msgs", "-o", tmp_path / "out")
    assert (code, out) == (1, "")
    assert "error: expected a folder to write to, got: " in err


def test_a_note_of_the_library_is_one_line_on_stderr(run):
    write("std_srvs/srv/Extra", "---")
    code, _, err = run("hash", "std_srvs/srv/Trigger")
    assert code == 0
    assert err.startswith("note: std_srvs/srv/Trigger is not in ")
    assert err.count("\n") == 1


def test_the_command_runs_as_a_module_too(workspace):
    done = subprocess.run(
        [sys.executable, "-m", "srvgen", "hash", "nonsense"], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.startswith("expected a type name such as")
