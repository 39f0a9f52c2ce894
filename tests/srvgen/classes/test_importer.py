"""The import hook: definitions are importable, and Python packages are not changed."""

from __future__ import annotations

import importlib
import importlib.resources
import importlib.util
import os
import pickle
import shutil
import sys

import pytest

import srvgen
from srvgen.classes import importer, loader
from srvgen.files.search import Search


@pytest.fixture
def workspace(tmp_path, monkeypatch):
    """A folder with `lecture_interfaces` that is also on the Python path, as beside a script."""
    folder = tmp_path / "lecture_interfaces" / "srv"
    folder.mkdir(parents=True)
    (folder / "RobotTask.srv").write_text("string task_type\n---\nbool success\n")
    (folder / "AddTwo.srv").write_text("int64 a\n---\nint64 b\n")
    monkeypatch.setattr(loader, "_search", Search())
    monkeypatch.syspath_prepend(tmp_path)
    before = set(sys.modules)
    yield tmp_path
    importer.uninstall_import_hook()
    for name in set(sys.modules) - before:
        if name.split(".")[0] in ("lecture_interfaces", "mixed", "std_srvs", "real_msgs"):
            del sys.modules[name]


def test_a_service_is_imported_straight_from_its_file(workspace):
    """Python alone would import the folder of the definitions as a namespace package."""
    srvgen.install_import_hook(workspace)
    from lecture_interfaces.srv import RobotTask  # type: ignore[import-not-found]

    assert repr(RobotTask.Request(task_type="move")) == (
        "lecture_interfaces.srv.RobotTask_Request(task_type='move')"
    )


def test_empty_name_returns_the_folder_itself(workspace):
    srvgen.install_import_hook(workspace)
    folder = __import__("lecture_interfaces.srv", fromlist=[""])
    assert folder.RobotTask.Request(task_type="move")


def test_load_gives_the_imported_class(workspace):
    srvgen.install_import_hook(workspace)
    from lecture_interfaces.srv import AddTwo  # type: ignore[import-not-found]
    from lecture_interfaces.srv._add_two import (  # type: ignore[import-not-found]
        AddTwo as Private,
    )
    from lecture_interfaces.srv._add_two import AddTwo_Request

    assert srvgen.load("lecture_interfaces/srv/AddTwo") is AddTwo is Private
    assert AddTwo_Request is AddTwo.Request
    assert srvgen.type_hash("lecture_interfaces/srv/AddTwo") == AddTwo._HASH


def test_bundled_packages_are_importable_without_paths(workspace):
    srvgen.install_import_hook()
    module = importlib.import_module("std_srvs.srv")
    assert module.Trigger is srvgen.load("std_srvs/srv/Trigger")
    assert "SetBool" in dir(module)
    assert "SetBool" in module.__all__


def test_python_modules_in_the_same_folder_stay_importable(workspace):
    (workspace / "lecture_interfaces" / "helper.py").write_text("ANSWER = 42\n")
    srvgen.install_import_hook(workspace)
    assert importlib.import_module("lecture_interfaces.helper").ANSWER == 42
    assert importlib.import_module("lecture_interfaces.srv").RobotTask


def test_a_python_package_with_definitions_in_it_keeps_its_own_code(workspace):
    folder = workspace / "mixed" / "srv"
    folder.mkdir(parents=True)
    (folder / "Ask.srv").write_text("int32 a\n---\n")
    (workspace / "mixed" / "__init__.py").write_text("OWN = True\n")
    srvgen.install_import_hook(workspace)
    assert importlib.import_module("mixed").OWN
    assert importlib.import_module("mixed.srv").Ask.Request(a=1).a == 1


def test_a_generated_package_wins(workspace):
    for part in ("", "srv"):
        folder = workspace / "real_msgs" / part
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "__init__.py").write_text("REAL = True\n")
    (workspace / "real_msgs" / "srv" / "Ask.srv").write_text("int32 a\n---\n")
    srvgen.install_import_hook(workspace)
    assert importlib.import_module("real_msgs.srv").REAL


def test_the_parts_of_services_and_actions_are_beside_them(workspace):
    """The official tools do not export an action's goal, result and feedback either."""
    srvgen.install_import_hook(workspace)
    from example_interfaces.action import (  # type: ignore[import-not-found]
        Fibonacci,
        Fibonacci_GetResult_Request,
    )
    from lecture_interfaces.srv import AddTwo, AddTwo_Event, AddTwo_Request, AddTwo_Response

    assert (AddTwo_Request, AddTwo_Response) == (AddTwo.Request, AddTwo.Response)
    assert AddTwo_Event is AddTwo.Event
    assert Fibonacci_GetResult_Request is Fibonacci.Impl.GetResultService.Request
    everything: dict[str, object] = {}
    exec("from lecture_interfaces.srv import *", everything)
    assert {"RobotTask", "RobotTask_Request", "AddTwo_Event"} <= set(everything)
    with pytest.raises(ImportError, match="no interface 'Fibonacci_Goal'"):
        from example_interfaces.action import Fibonacci_Goal  # noqa: F401


@pytest.mark.parametrize(
    "name", ["lecture_interfaces.msg", "lecture_interfaces.srv._no_such", "no_such_package_at_all"]
)
def test_missing_interface_is_an_import_error(workspace, name):
    srvgen.install_import_hook(workspace)
    with pytest.raises(ModuleNotFoundError, match=name):
        importlib.import_module(name)


def test_misspelt_name_gives_a_suggestion(workspace):
    srvgen.install_import_hook(workspace)
    module = importlib.import_module("lecture_interfaces.srv")
    with pytest.raises(AttributeError, match="no interface 'RobotTsk'; did you mean RobotTask"):
        _ = module.RobotTsk
    with pytest.raises(ImportError, match=r"name 'RobotTsk': .* did you mean RobotTask"):
        from lecture_interfaces.srv import RobotTsk  # type: ignore[import-not-found] # noqa: F401


def test_misspelt_package_or_folder_gives_a_suggestion(workspace):
    srvgen.install_import_hook(workspace)
    with pytest.raises(ModuleNotFoundError, match="did you mean lecture_interfaces") as caught:
        importlib.import_module("lectur_interfaces.srv")
    assert caught.value.name == "lectur_interfaces"
    with pytest.raises(ModuleNotFoundError, match=r"lecture_interfaces has srv$"):
        importlib.import_module("lecture_interfaces.src")


@pytest.mark.parametrize(
    ("statement", "right"),
    [
        (
            "from lecture_interfaces import AddTwo",
            "write: from lecture_interfaces.srv",
        ),
        (
            "import lecture_interfaces.srv.AddTwo",
            "it is a class: from lecture_interfaces.srv",
        ),
    ],
)
def test_import_from_the_wrong_place_names_the_right_one(workspace, statement, right):
    srvgen.install_import_hook(workspace)
    with pytest.raises(ImportError, match=right):
        exec(statement)


def test_package_with_a_similar_name_is_not_found(workspace):
    srvgen.install_import_hook(workspace)
    for name in ("lecture_interfaces_py", "std_messages", "nav", "lectures"):
        assert importlib.util.find_spec(name) is None


def test_an_imported_class_is_that_of_load_until_its_file_is_edited(workspace):
    srvgen.install_import_hook(workspace)
    before = importlib.import_module("lecture_interfaces.srv").AddTwo
    assert srvgen.load("lecture_interfaces/srv/AddTwo") is before
    (workspace / "lecture_interfaces" / "srv" / "AddTwo.srv").write_text("int64 a\nint8 c\n---\n")
    after = srvgen.load("lecture_interfaces/srv/AddTwo")
    assert after is not before
    assert after is srvgen.load("lecture_interfaces/srv/AddTwo")
    assert importlib.import_module("lecture_interfaces.srv").AddTwo is before


def test_error_of_an_invalid_definition_has_its_position(workspace):
    (workspace / "lecture_interfaces" / "srv" / "Broken.srv").write_text("int32\n---\n")
    srvgen.install_import_hook(workspace)
    with pytest.raises(srvgen.DefinitionError) as caught:
        from lecture_interfaces.srv import Broken  # type: ignore[import-not-found] # noqa: F401
    assert caught.value.path.endswith(f"srv{os.sep}Broken.srv")
    assert caught.value.line == 1
    from lecture_interfaces.srv import RobotTask

    assert RobotTask, "the others are not hurt"


def test_second_install_changes_nothing(workspace):
    srvgen.install_import_hook(workspace)
    srvgen.install_import_hook(workspace)
    srvgen.install_import_hook()
    assert sys.meta_path.count(importer._finder) == 1
    assert loader.search().paths == [workspace.resolve()]


def test_uninstalling_removes_finders_paths_and_modules(workspace):
    srvgen.install_import_hook(workspace)
    importlib.import_module("lecture_interfaces.srv._robot_task")
    importer.uninstall_import_hook()
    importer.uninstall_import_hook()
    assert not {importer._finder, importer._suggestion_finder} & set(sys.meta_path)
    assert not [name for name in sys.modules if name.startswith("lecture_interfaces")]
    with pytest.raises(ImportError):
        importlib.import_module("std_srvs.srv")


def test_other_imports_are_not_changed(workspace):
    srvgen.install_import_hook(workspace)
    for name in ("json", "numpy", "numpy.core", "_private", "lecture_interfaces.other"):
        assert importer._finder.find_spec(name, None) is None


@pytest.fixture
def weather(tmp_path, monkeypatch):
    """Definitions beside Python modules and files, in packages without and with `__init__`."""
    folder = tmp_path / "weather"
    (folder / "msg").mkdir(parents=True)
    (folder / "msg" / "Reading.msg").write_text("float64 celsius\n")
    (folder / "msg" / "helper.py").write_text("ANSWER = 42\n")
    (folder / "data.txt").write_text("dry")
    shutil.copytree(folder, tmp_path / "regular")
    (tmp_path / "regular" / "__init__.py").touch()
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    srvgen.install_import_hook()
    yield folder
    importer.uninstall_import_hook()
    for name in [one for one in sys.modules if one.partition(".")[0] in ("weather", "regular")]:
        del sys.modules[name]


@pytest.mark.parametrize("package", ["weather", "regular"])
def test_python_modules_beside_definitions_are_imported(weather, package):
    assert importlib.import_module(f"{package}.msg.helper").ANSWER == 42
    assert importlib.import_module(f"{package}.msg").Reading(celsius=1.5).celsius == 1.5
    scope: dict[str, object] = {}
    exec(f"from {package}.msg import Reading, helper", scope)
    assert {"Reading", "helper"} <= set(scope)


@pytest.mark.parametrize("package", ["weather", "regular"])
def test_files_beside_definitions_are_read_as_resources(weather, package):
    files = importlib.resources.files
    assert files(package).joinpath("data.txt").read_text() == "dry"
    assert files(package).joinpath("msg/Reading.msg").read_text() == "float64 celsius\n"
    assert files(f"{package}.msg").joinpath("Reading.msg").read_text() == "float64 celsius\n"


def test_folder_of_a_package_that_is_added_later_is_found(weather, monkeypatch, tmp_path):
    importlib.import_module("weather")
    (tmp_path / "more" / "weather").mkdir(parents=True)
    (tmp_path / "more" / "weather" / "late.py").write_text("ANSWER = 43\n")
    monkeypatch.syspath_prepend(str(tmp_path / "more"))
    assert importlib.import_module("weather.late").ANSWER == 43


@pytest.mark.parametrize("text", ["float64 celsius\nfloat64 wind\n", "float32 celsius\n", ""])
def test_a_pickled_message_never_becomes_one_of_another_definition(weather, text):
    name = "weather/msg/Reading"
    data = pickle.dumps(srvgen.define(name, text)())
    with pytest.raises(srvgen.DefinitionError, match=f"the pickled {name} .*, got another one"):
        pickle.loads(data)


def test_a_pickled_message_becomes_one_of_the_class_on_disk_where_fields_are_the_same(weather):
    name = "weather/msg/Reading"
    own = srvgen.define(name, "float64 celsius 20.0\n")()
    assert pickle.loads(pickle.dumps(own)) == srvgen.load(name)(celsius=20.0)
    same = srvgen.define(name, "float64 celsius\n")(celsius=1.5)
    assert pickle.loads(pickle.dumps(same)) == same


def test_package_of_definitions_has_no_file_attribute(weather):
    assert importlib.import_module("weather").__file__ is None
    assert importlib.import_module("weather.msg").__file__ is None


@pytest.mark.parametrize(
    "name",
    ["weathr", "weather.nope", "weather.msg.nope", "weather.msg.Reading", "regular.msg.nope"],
)
def test_find_spec_returns_none_for_an_unknown_module(weather, name):
    assert importlib.util.find_spec(name) is None
    with pytest.raises(ImportError):
        importlib.import_module(name)


def test_failed_import_gives_a_suggestion(weather):
    with pytest.raises(ImportError, match="did you mean Reading"):
        from weather.msg import Redaing  # noqa: F401
    with pytest.raises(ModuleNotFoundError, match="did you mean weather"):
        import weathr  # noqa: F401
