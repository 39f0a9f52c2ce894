"""The files and names of types that a command of `srvgen` is given."""

import json
import re
from collections import Counter
from pathlib import Path

import pytest

from srvgen.cli.sources import definition_files, files_of, search_paths
from srvgen.errors import DefinitionError
from srvgen.files.search import Search
from tests.srvgen.sample_definitions import put

pytestmark = pytest.mark.usefixtures("workspace")


def test_hint_says_where_to_move_a_misplaced_definition(run):
    Path("my_msgs").mkdir()
    Path("my_msgs/Ape.msg").touch()
    code, _, err = run("show", "my_msgs/msg/Ape")
    assert code == 1
    assert "hint: move my_msgs/Ape.msg to my_msgs/msg/Ape.msg\n" in err


def test_check_without_sources_checks_the_current_folder(run):
    code, _, err = run("check")
    assert (code, err.splitlines()[0]) == (
        1,
        ".: error: expected definitions (.msg, .srv, .action), got a folder without any",
    )
    put("my_msgs/srv/Fetch", "---\n")
    assert run("check") == (0, "1 definition, no problems\n", "")


def test_missing_source_is_reported_with_similar_names(run):
    put("my_msgs/srv/Fetch", "---\n")
    nothing = "expected a file, a folder or the name of a type, got a path that does not exist"
    assert run("check", "my_msg") == (
        1,
        "",
        f"my_msg: error: {nothing}\n  hint: did you mean my_msgs?\n",
    )
    gone = Path("my_msgs/srv/Fetsh.srv")
    for command in ("check", "describe", "show", "hash"):
        assert run(command, gone) == (
            1,
            "",
            f"{gone}: error: {nothing}\n  hint: did you mean Fetch.srv?\n",
        )


def test_every_command_takes_files_and_names_of_types(run, tmp_path):
    path = put("my_msgs/srv/Fetch", "geometry_msgs/Point where\n---\n")
    stray = tmp_path / "Fetch.srv"
    stray.write_text("int32 a\n---\n")
    for command in ("show", "hash", "describe", "check"):
        by_name = run(command, "my_msgs/srv/Fetch")
        assert by_name[0] == 0
        assert run(command, path) == run(command, "my_msgs/Fetch") == by_name
        assert run(command, stray)[0] == 0
    assert json.loads(run("describe", "std_srvs/srv/Trigger_Request")[1])["type"] == (
        "std_srvs/srv/Trigger_Request"
    )
    assert run("check", "std_srvs")[1] == "3 definitions, no problems\n"
    assert run("generate", "std_srvs/Trigger", "-o", "out")[0] == 0
    assert Path("out/std_srvs/srv/_trigger.py").is_file()


def test_a_folder_and_a_dangling_link_with_the_name_of_a_definition_are_reported(run, symlink):
    put("my_msgs/srv/Fetch", "---\n")
    Path("my_msgs/srv/Folder.srv").mkdir()
    code, _, err = run("check", "my_msgs")
    assert code == 1
    assert err.endswith("Folder.srv: error: expected a readable file, got: a folder\n")
    Path("my_msgs/srv/Folder.srv").rmdir()
    symlink("my_msgs/srv/Gone.srv", "nowhere")
    assert "Gone.srv: error: expected a readable file, got: " in run("check", "my_msgs")[2]


def test_hints_name_only_types_that_can_be_loaded(run, symlink):
    """A folder or a broken link is not a definition, even with such a name."""
    put("my_msgs/msg/Good", "int32 a\n")
    Path("my_msgs/msg/D.msg").mkdir()
    symlink("my_msgs/msg/F.msg", "nowhere")
    for name in ("my_msgs/msg/DD", "my_msgs/E", "D", "my_msgs/F", "my_msgs/msg/d"):
        code, _, err = run("show", name)
        assert (code, "hint:" in err) == (1, False), err
    for path in ("my_msgs/msg/DD.msg", "my_msgs/msg/FF.msg"):
        assert not re.search(r"mean .*\b[DF]\.msg", run("check", path)[2])
    assert "did you mean Good?" in run("show", "my_msgs/msg/Goood")[2]
    assert "did you mean Good.msg?" in run("check", "my_msgs/msg/Goood.msg")[2]


@pytest.mark.parametrize(("command", "looks"), [(["generate", "-o", "out"], 1), (["fix"], 2)])
def test_each_type_is_looked_up_once_and_once_more_after_fixing(run, monkeypatch, command, looks):
    for name in ("A", "B", "C"):
        put(f"my_msgs/msg/{name}", "std_msgs/Header header\ngeometry_msgs/Pose[] poses\n")
    put("my_msgs/srv/Ask", "A a\nB b\n---\nC c\ngeometry_msgs/Point p\n")
    counted: Counter[str] = Counter()
    look = Search._look

    def counting(self, name, folders):
        counted[str(name)] += 1
        return look(self, name, folders)

    monkeypatch.setattr(Search, "_look", counting)
    assert run(command[0], "my_msgs", *command[1:]) == (0, "", "")
    assert counted["geometry_msgs/msg/Pose"] > 0
    assert max(counted.values()) <= looks, counted.most_common(3)


def write(path: Path, data: bytes = b"---\n") -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)
    return path


def test_a_source_is_a_file_a_package_a_folder_of_packages_or_a_workspace(tmp_path):
    packages = tmp_path / "workspace" / "src"
    a = write(packages / "a_msgs" / "srv" / "A.srv")
    b = write(packages / "b_msgs" / "msg" / "B.msg")
    slip = write(packages / "b_msgs" / "msg" / "C.msg.txt")
    write(packages / "b_msgs" / "msg" / "notes.txt")
    write(packages / "b_msgs" / "msg" / ".hidden.msg")
    assert definition_files(a) == [a]
    assert definition_files(a.parent) == [a]
    assert definition_files(packages / "b_msgs") == [b, slip]
    assert definition_files(packages) == definition_files(tmp_path / "workspace") == [a, b, slip]


def test_a_source_without_definitions_is_refused(tmp_path):
    with pytest.raises(DefinitionError, match="a folder without any"):
        definition_files(tmp_path)
    with pytest.raises(DefinitionError, match="a path that does not exist") as caught:
        files_of(str(tmp_path / "gone"), Search())
    assert (caught.value.line, caught.value.path) == (0, str(tmp_path / "gone"))


def test_neighbours_of_a_source_are_found(tmp_path, monkeypatch):
    a = write(tmp_path / "a_msgs" / "srv" / "A.srv")
    expected = [tmp_path / "a_msgs", tmp_path]
    for source in (a, a.parent, a.parents[1]):
        assert search_paths([str(source), "std_srvs/srv/Trigger"]) == expected
    monkeypatch.chdir(a.parent)
    assert search_paths(["A.srv", "."]) == expected


def test_packages_at_any_depth_below_src_are_found(tmp_path):
    near = write(tmp_path / "src" / "a_msgs" / "srv" / "A.srv")
    far = write(tmp_path / "src" / "group" / "b" / "c" / "d_msgs" / "msg" / "D.msg", b"int8 d\n")
    write(tmp_path / "src" / "group" / "build" / "x_msgs" / "msg" / "D.msg")
    write(tmp_path / "src" / "old" / "x_msgs" / "msg" / "D.msg")
    write(tmp_path / "src" / "old" / "COLCON_IGNORE")
    write(tmp_path / "src" / "a_msgs" / "test" / "x_msgs" / "msg" / "D.msg")
    for source in (tmp_path, tmp_path / "src"):
        assert definition_files(source) == [near, far]
        assert {tmp_path / "src", far.parents[2]} <= set(search_paths([str(source)]))
