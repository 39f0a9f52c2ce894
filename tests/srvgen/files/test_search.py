"""Definitions are found in the documented order; errors name missing types."""

import logging
import os
import sys
import threading
from pathlib import Path

import pytest

from srvgen.definitions.model import MessageDef, ServiceDef
from srvgen.errors import DefinitionError
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put, put_all

pytestmark = pytest.mark.usefixtures("workspace")


def test_packages_in_the_working_directory_or_its_src_are_found(workspace):
    one = put("one_msgs/msg/A", "int32 a", workspace)
    two = put("two_msgs/srv/B", "---", workspace / "src")
    assert Search().find("one_msgs/msg/A") == one
    assert Search().find("two_msgs/srv/B") == two


def test_the_working_directory_may_be_a_package_itself(workspace, monkeypatch):
    path = put("one_msgs/msg/A", "int32 a", workspace)
    monkeypatch.chdir(workspace / "one_msgs")
    assert Search().find("one_msgs/msg/A") == path


def test_packages_beside_the_program_are_found_from_any_directory(tmp_path, monkeypatch):
    path = put("one_msgs/msg/A", "int32 a", tmp_path / "project")
    with pytest.raises(DefinitionError):
        Search().find("one_msgs/msg/A")
    script = str(tmp_path / "project" / "program.py")
    monkeypatch.setattr(sys.modules["__main__"], "__file__", script, raising=False)
    assert Search().find("one_msgs/msg/A") == path


def test_given_paths_may_be_relative_packages_or_folders_of_packages(workspace, monkeypatch):
    path = put("one_msgs/msg/A", "int32 a", workspace / "elsewhere")
    assert Search(["elsewhere"]).find("one_msgs/msg/A") == path
    assert Search([path.parents[1]]).find("one_msgs/msg/A") == path
    monkeypatch.chdir(path.parent)
    assert Search([".."]).find("one_msgs/msg/A") == path


def test_the_environment_is_read_at_every_load(workspace, tmp_path, monkeypatch):
    search = Search()
    with pytest.raises(DefinitionError, match="package 'far_msgs' not found"):
        search.load("far_msgs/msg/A")
    first = put("far_msgs/msg/A", "int32 a", tmp_path / "first")
    second = put("other_msgs/msg/A", "int32 a", tmp_path / "second")
    folders = os.pathsep.join([str(tmp_path / "first"), str(tmp_path / "second"), ""])
    monkeypatch.setenv("TASKRPC_INTERFACE_PATH", folders)
    assert search.find("far_msgs/msg/A") == first
    assert search.find("other_msgs/msg/A") == second
    third = put("ament_msgs/msg/A", "int32 a", tmp_path / "prefix" / "share")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    assert search.find("ament_msgs/msg/A") == third


def test_a_file_is_parsed_again_only_when_it_has_changed(workspace):
    path = put("one_msgs/msg/A", "int32 a", workspace)
    search = Search()
    before = search.load("one_msgs/msg/A")
    assert search.load("one_msgs/msg/A") is before
    path.write_text("int32 another", encoding="utf-8")
    assert search.load("one_msgs/msg/A").fields[0].name == "another"


@pytest.mark.parametrize(
    "name",
    ["AddTwoInts_Request", "AddTwoInts_Response", "AddTwoInts_Event"],
)
def test_derived_types_of_a_service_can_be_loaded(name):
    loaded = Search().load(f"example_interfaces/srv/{name}")
    assert isinstance(loaded, MessageDef)
    assert loaded.full_name == f"example_interfaces/srv/{name}"


def test_derived_types_of_an_action_can_be_loaded():
    search = Search()
    send_goal = search.load("example_interfaces/action/Fibonacci_SendGoal")
    assert isinstance(send_goal, ServiceDef)
    assert search.load(f"{send_goal.full_name}_Request") == send_goal.request
    event = search.load("example_interfaces/action/Fibonacci_GetResult_Event")
    assert [field.name for field in event.fields] == ["info", "request", "response"]


def test_short_name_is_accepted_if_it_means_one_type(workspace):
    put("one_msgs/msg/A", "int32 a", workspace)
    put("one_msgs/srv/B", "---", workspace)
    search = Search()
    assert search.load("one_msgs/B").full_name == "one_msgs/srv/B"
    put("one_msgs/srv/A", "---", workspace)
    with pytest.raises(DefinitionError, match="may mean one_msgs/msg/A or one_msgs/srv/A"):
        search.load("one_msgs/A")


def test_packages_and_interfaces_are_listed_once(workspace):
    local = put("std_srvs/srv/Extra", "---", workspace)
    search = Search()
    packages = search.packages()
    assert packages["std_srvs"] == [local.parents[1], BUNDLED / "std_srvs"]
    assert list(packages) == sorted(packages)
    assert search.interfaces("std_srvs") == [
        "std_srvs/srv/Empty",
        "std_srvs/srv/Extra",
        "std_srvs/srv/SetBool",
        "std_srvs/srv/Trigger",
    ]
    with pytest.raises(DefinitionError, match="package 'nowhere_msgs' not found"):
        search.interfaces("nowhere_msgs")


def test_local_interface_comes_first_and_a_bundled_one_is_used_with_one_note(workspace, caplog):
    caplog.set_level(logging.INFO, "srvgen")
    local = put("std_srvs/srv/Trigger", "int32 mine\n---\n", workspace)
    search = Search()
    assert search.find("std_srvs/srv/Trigger") == local
    assert not caplog.records
    assert search.find("std_srvs/srv/SetBool").is_relative_to(BUNDLED)
    search.load("std_srvs/srv/Empty")
    assert [record.levelno for record in caplog.records] == [logging.WARNING]
    assert "std_srvs/srv/SetBool is not in" in caplog.text
    assert "differs in Trigger" in caplog.text


def test_the_note_is_only_information_while_the_local_package_equals_the_bundled_one(
    workspace, caplog
):
    caplog.set_level(logging.INFO, "srvgen")
    text = (BUNDLED / "std_srvs/srv/Trigger.srv").read_text(encoding="utf-8")
    put("std_srvs/srv/Trigger", text.replace("\n", "\r\n"), workspace)
    Search().load("std_srvs/srv/SetBool")
    assert [record.levelno for record in caplog.records] == [logging.INFO]


def test_there_is_no_note_about_the_actions_of_a_package_that_has_none(workspace, caplog):
    caplog.set_level(logging.INFO, "srvgen")
    put("tf2_msgs/srv/FrameGraph", "int32 mine\n---\n", workspace)
    Search().load("tf2_msgs/action/LookupTransform")
    assert not caplog.records


@pytest.mark.parametrize(
    ("name", "message", "hint"),
    [
        ("std_msg/msg/String", "package 'std_msg' not found", "did you mean std_msgs"),
        ("std_msgs/msg/Strin", "package 'std_msgs' has no message 'Strin'", "String"),
        ("std_msgs/srv/String", "has no service 'String'", "std_msgs/msg/String"),
        ("std_srvs/srv/Trigger_Foo", "has no service 'Trigger_Foo'", "Trigger"),
        ("std_srvs/srv/trigger", "has no service 'trigger'", "did you mean Trigger"),
        ("Trigger", "expected a type name such as", "or std_srvs/srv/Trigger?"),
        ("std_srvs.srv.Trigger", "expected a type name", "did you mean std_srvs/srv/Trigger?"),
        ("std_srvs/srv/Trigger.srv", "expected a type name", "mean std_srvs/srv/Trigger?"),
        ("std_srvs/Triger", "has no type 'Triger'", "did you mean std_srvs/srv/Trigger?"),
        ("nowhere_srvs/Triger", "package 'nowhere_srvs' not found", ""),
    ],
)
def test_missing_type_is_reported_with_similar_names(name, message, hint):
    with pytest.raises(DefinitionError) as caught:
        Search().load(name)
    assert message in caught.value.message
    assert hint in caught.value.hint


def test_name_that_is_too_long_for_the_file_system_is_unknown():
    with pytest.raises(DefinitionError, match="has no message"):
        Search().find(f"std_msgs/msg/{'A' * 5000}")


def test_a_deleted_working_directory_leaves_the_bundled_packages(workspace):
    if os.name == "nt":
        pytest.skip("Windows does not let go of a working directory")
    workspace.rmdir()
    assert Search().load("std_srvs/srv/Empty").full_name == "std_srvs/srv/Empty"


def test_definition_beside_the_script_gives_a_hint(workspace):
    Path("Fetch.srv").write_text("---", encoding="utf-8")
    with pytest.raises(DefinitionError) as caught:
        Search().load("my_msgs/srv/Fetch")
    assert caught.value.hint == "move Fetch.srv to my_msgs/srv/Fetch.srv"


def test_type_name_that_is_not_a_str_is_a_type_error():
    with pytest.raises(TypeError, match="got 3"):
        Search().load(3)


def test_installation_of_ros_2_is_found(tmp_path, monkeypatch):
    """ROS 2 installs .idl files too, and older releases also the parts of services."""
    share = tmp_path / "opt" / "share"
    others = ("msg/Goal.idl", "msg/Goal.json", "srv/Ask.idl")
    halves = ("srv/Ask_Request.msg", "srv/Ask_Response.msg")
    put("far_msgs/msg/Goal", "int32 a\n", share)
    put("far_msgs/srv/Ask", "Goal goal\nstd_msgs/Header h\n---\n", share)
    put_all(dict.fromkeys((*others, *halves), "nonsense\n"), share / "far_msgs")
    put_all({"package.xml": "<package/>"}, share / "far_msgs")
    put_all({"msg/Thing.idl": "module idl_only_msgs {};\n"}, share / "idl_only_msgs")
    (share / "ament_index" / "resource_index").mkdir(parents=True)
    overlay = put("std_msgs/msg/Header", "int32 overlaid\n", tmp_path / "overlay" / "share")
    prefixes = [tmp_path / "overlay", tmp_path / "opt", tmp_path / "gone"]
    monkeypatch.setenv("AMENT_PREFIX_PATH", os.pathsep.join(map(str, prefixes)))
    search = Search()
    assert search.interfaces("far_msgs") == ["far_msgs/msg/Goal", "far_msgs/srv/Ask"]
    assert search.find("std_msgs/msg/Header") == overlay
    needed = [one.full_name for one in search.with_dependencies("far_msgs/srv/Ask")]
    assert {"far_msgs/msg/Goal", "std_msgs/msg/Header"} < set(needed)
    assert search.load("far_msgs/srv/Ask_Request").fields[0].name == "goal"
    assert "idl_only_msgs" not in search.packages()


def test_cached_lookups_do_not_see_new_files(workspace):
    search = Search()
    with search.cached_lookups():
        assert search.is_missing("one_msgs/msg/A")
        put("one_msgs/msg/A", "int32 a", workspace)
        assert search.is_missing("one_msgs/msg/A")
    assert not search.is_missing("one_msgs/msg/A")


def test_threads_do_not_share_their_lookup_caches(tmp_path):
    """A cache that is never closed would hide new files."""
    shared = Search([tmp_path])
    inside, leave = threading.Barrier(2), threading.Barrier(2)

    def first():
        with shared.cached_lookups():
            inside.wait()
            leave.wait()

    thread = threading.Thread(target=first)
    thread.start()
    with shared.cached_lookups():
        inside.wait()
        leave.wait()
        thread.join()
    assert shared._cache is None
    assert shared.is_missing("new_msgs/msg/New")
    put("new_msgs/msg/New", "int32 x\n", tmp_path)
    assert not shared.is_missing("new_msgs/msg/New")


def test_definitions_in_subfolders_of_a_kind_are_found_under_the_package(workspace):
    deep = put("robot_msgs/msg/Pose", "int32 x", workspace)
    inner = deep.parent / "arm" / "left" / "Joint.msg"
    inner.parent.mkdir(parents=True)
    inner.write_text("Pose pose\n", encoding="utf-8")
    (deep.parents[1] / "srv" / "arm").mkdir(parents=True)
    service = deep.parents[1] / "srv" / "arm" / "Move.srv"
    service.write_text("Joint joint\n---\n", encoding="utf-8")
    search = Search()
    assert search.find("robot_msgs/msg/Joint") == inner
    assert search.find("robot_msgs/srv/Move_Request") == service
    assert [one.full_name for one in search.with_dependencies("robot_msgs/srv/Move")][:2] == [
        "robot_msgs/msg/Pose",
        "robot_msgs/msg/Joint",
    ]
    names = ["robot_msgs/msg/Joint", "robot_msgs/msg/Pose", "robot_msgs/srv/Move"]
    assert search.interfaces("robot_msgs") == names
    with search.cached_lookups():
        assert search.find("robot_msgs/Move") == service


def test_a_package_may_have_definitions_in_subfolders_only(workspace, symlink):
    inner = workspace / "robot_msgs" / "action" / "arm" / "Reach.action"
    inner.parent.mkdir(parents=True)
    inner.write_text("---\n---\n", encoding="utf-8")
    symlink(inner.parent / "round", inner.parents[1])
    assert Search().interfaces("robot_msgs") == ["robot_msgs/action/Reach"]
