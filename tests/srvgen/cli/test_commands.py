"""What the verbs of `srvgen` print, write and return."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.srvgen.sample_definitions import put, put_all

pytestmark = pytest.mark.usefixtures("workspace")


def test_check_accepts_valid_definitions(run):
    put("my_msgs/srv/Fetch", "geometry_msgs/Point where\n---\n")
    assert run("check", "my_msgs") == (0, "1 definition, no problems\n", "")


def test_check_reports_every_problem_of_every_file_with_a_caret(run):
    bad = put("my_msgs/msg/Bad", "int a\nint32 B\n")
    lost = put("my_msgs/srv/Lost", "Header header\nBad bad\n---\n")
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


def test_error_of_a_whole_file_has_no_line_number(run):
    path = put("my_msgs/srv/add", "---")
    slip = path.with_name("Sub.srv.txt")
    slip.write_text("---", encoding="utf-8")
    code, _, err = run("check", path, slip)
    assert code == 1
    assert f"{path}: error: expected a type name" in err
    assert f"{slip}: error: expected a file that ends in" in err


def test_two_files_of_a_package_that_define_one_type_are_an_error(run):
    first = put("my_msgs/msg/Dot", "int32 x\n")
    (first.parents[1] / "package.xml").write_text("<package/>", encoding="utf-8")
    second = first.parent / "plane" / "Dot.msg"
    second.parent.mkdir()
    second.write_text("int8 x\n", encoding="utf-8")
    code, out, err = run("check", "my_msgs")
    assert (code, out) == (1, "")
    assert f"{second}: error: expected only one file that defines Dot, got a second one\n" in err
    assert f"hint: the other is {first}: rename" in err


def test_check_prints_json_lines_for_programs(run):
    path = put("my_msgs/msg/Bad", "int a\nint b\n")
    code, out, err = run("check", "--json", path)
    assert (code, out) == (1, "")
    first, second = map(json.loads, err.splitlines())
    assert (first["error"], first["line"], second["line"]) == ("DefinitionError", 1, 2)
    assert first["message"].endswith("got 'int'")
    assert first["path"] == str(path)


def test_describe_prints_one_line_per_interface_and_continues_after_an_error(run):
    good = put("my_msgs/srv/Fetch", "nowhere_msgs/Thing thing\nfloat32 NAN=nan\n---\n")
    bad = put("my_msgs/msg/Bad", "int a")
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
    put("far_msgs/srv/Fetch", "# Fetches.\nint32 a # one\n---\n", tmp_path / "far")
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


def test_generated_packages_can_be_imported_and_are_then_up_to_date(run, tmp_path):
    put("my_msgs/srv/Fetch", "string what\n---\nbool found\n")
    put("my_msgs/msg/Bad", "int a")
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


def test_module_without_a_definition_is_removed_and_reported_by_check(run, tmp_path):
    put("my_msgs/srv/Fetch", "---\n")
    gone = put("my_msgs/srv/Bring", "---\n")
    out = tmp_path / "out"
    assert run("generate", "my_msgs", "-o", out) == (0, "", "")
    gone.unlink()
    module = out / "my_msgs" / "srv" / "_bring.py"
    code, _, err = run("generate", "my_msgs", "-o", out, "--check")
    assert code == 1
    assert f"{module} no longer has a definition: run srvgen generate\n" in err
    assert module.exists()
    assert run("generate", "my_msgs", "-o", out) == (0, "", "")
    assert not module.exists()
    assert run("generate", "my_msgs", "-o", out, "--check") == (0, "", "")


def test_output_of_a_removed_package_is_deleted_and_reported_by_check(run, gone):
    problem = f"{gone} no longer has a definition"
    assert run("generate", "ws", "-o", "out", "--check") == (
        1,
        "",
        f"{problem}: run srvgen generate\n",
    )
    assert gone.exists()
    said = f"removed {gone}, which no longer has definitions\n"
    assert run("generate", "ws", "-o", "out") == (0, said, "")
    assert [one.name for one in Path("out").iterdir()] == ["my_msgs"]
    assert run("generate", "ws", "-o", "out", "--check") == (0, "", "")


@pytest.mark.parametrize("name", ["notes.txt", "msg/own.py", "py.typed", "msg/__pycache__/x.txt"])
def test_files_that_srvgen_has_not_generated_are_kept(run, gone, name):
    put_all({name: "mine\n"}, gone)
    assert run("generate", "ws", "-o", "out", "--check")[0] == 1
    code, out, err = run("generate", "ws", "-o", "out")
    assert (code, err) == (0, "")
    assert out.endswith(" no longer has definitions; other files in it are kept\n")
    assert (gone / name).read_text() == "mine\n"
    assert not (gone / "msg/_old.py").exists()
    assert run("generate", "ws", "-o", "out", "--check") == (0, "", "")


def test_generating_one_package_keeps_the_others(run, gone):
    assert run("generate", "ws/my_msgs", "-o", "out", "--check") == (0, "", "")
    assert run("generate", "ws/my_msgs", "-o", "out") == (0, "", "")
    assert (gone / "msg/_old.py").exists()


def test_output_of_a_package_found_elsewhere_is_kept(run, gone):
    put("old_msgs/msg/Old", "int32 x\n", Path("far"))
    assert run("generate", "ws", "-I", "far", "-o", "out") == (0, "", "")
    assert (gone / "msg/_old.py").exists()


def test_module_is_kept_while_its_definition_is_invalid(run, tmp_path):
    put("my_msgs/srv/Fetch", "---\n")
    broken = put("my_msgs/srv/Bring", "---\n")
    out = tmp_path / "out"
    run("generate", "my_msgs", "-o", out)
    broken.write_text("int a\n---\n", encoding="utf-8")
    assert run("generate", "my_msgs", "-o", out)[0] == 1
    assert (out / "my_msgs" / "srv" / "_bring.py").exists()


def test_a_folder_that_cannot_be_written_is_one_message(run, tmp_path):
    put("my_msgs/srv/Fetch", "---\n")
    (tmp_path / "out").write_text("a file", encoding="utf-8")
    code, out, err = run("generate", "my_msgs", "-o", tmp_path / "out")
    assert (code, out) == (1, "")
    assert "error: expected a folder to write to, got: " in err


def test_syntax_errors_and_missing_types_of_all_files_are_reported_in_one_run(run):
    put("my_msgs/msg/Zoo", "Broken b\nint i\n")
    put("my_msgs/msg/Ape", "Headerr h\nint i\nstd_msg/Header g\nOther b\nHeader h2\nPoint p\n")
    put("my_msgs/msg/Broken", "int32\nOther c\n")
    code, _, err = run("check", "--json", "my_msgs")
    assert code == 1
    problems = [json.loads(line) for line in err.splitlines()]
    assert [(Path(one["path"]).stem, one["line"], one.get("hint", "")) for one in problems] == [
        ("Ape", 1, "did you mean std_msgs/Header?"),
        ("Ape", 2, "did you mean int32?"),
        ("Ape", 3, "did you mean std_msgs?"),
        ("Ape", 4, ""),
        ("Ape", 5, "ROS 2 writes std_msgs/Header"),
        ("Ape", 6, "did you mean geometry_msgs/Point?"),
        ("Broken", 1, "the name is missing: int32 value"),
        ("Broken", 2, ""),
        ("Zoo", 2, "did you mean int32?"),
    ]
    assert str(Path.cwd()) in problems[2]["looked_in"]


def test_types_of_an_invalid_package_are_not_reported_as_missing(run):
    put("My_msgs/msg/Ape", "Other a\n")
    _, _, err = run("check", "My_msgs/msg/Ape.msg")
    assert err.count("error:") == 1
    assert "hint: rename the package to my_msgs" in err


def test_missing_type_names_the_misnamed_file(run):
    put("my_msgs/msg/ape", "int32 a\n")
    put("my_msgs/msg/Zoo", "Ape a\n")
    assert "hint: rename msg/ape.msg to Ape.msg\n" in run("check", "my_msgs")[2]


def test_miscapitalised_type_gives_a_suggestion(run):
    put("my_msgs/msg/UInt9", "int32 a\n")
    put("my_msgs/msg/Zoo", "Uint9 a\n")
    assert "hint: did you mean UInt9?\n" in run("check", "my_msgs")[2]


def test_files_that_are_generated_one_by_one_stay_together(run, tmp_path):
    first = put("my_msgs/srv/Fetch", "---\n")
    second = put("my_msgs/srv/Bring", "---\n")
    out = tmp_path / "out"
    for path in (first, second):
        assert run("generate", path, "-o", out) == (0, "", "")
    init = (out / "my_msgs" / "srv" / "__init__.py").read_text()
    assert "import Fetch as Fetch, Fetch_Event as Fetch_Event," in init
    assert "import Bring as Bring, Bring_Event as Bring_Event," in init
    for source in (first, second, "my_msgs"):
        assert run("generate", source, "-o", out, "--check") == (0, "", "")
    second.unlink()
    assert run("generate", first, "-o", out) == (0, "", "")
    assert (out / "my_msgs" / "srv" / "_bring.py").is_file(), "no command has removed it"


@pytest.fixture
def gone(run, tmp_path):
    """The output for `old_msgs`, which is no longer in the workspace."""
    put("my_msgs/msg/Here", "int32 x\n", Path("ws"))
    old = put("old_msgs/msg/Old", "int32 x\n", Path("ws"))
    assert run("generate", "ws", "-o", "out") == (0, "", "")
    Path("out/old_msgs/msg/__pycache__").mkdir()
    Path("out/old_msgs/msg/__pycache__/_old.cpython-311.pyc").write_bytes(b"\0")
    old.unlink()
    return Path("out/old_msgs")
