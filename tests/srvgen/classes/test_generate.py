"""Generated packages: the same bytes as the golden files, importable, clean for type checkers."""

from __future__ import annotations

import ast
import importlib
import os
import pickle
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest

import srvgen
from srvgen.classes.generate import generate
from srvgen.classes.output import write_tree
from srvgen.classes.render import GENERATED
from srvgen.cli.main import main
from srvgen.errors import DefinitionError
from srvgen.files.reading import read_definition
from srvgen.files.search import BUNDLED, Search
from tests.srvgen.sample_definitions import put_all

GOLDEN = Path(__file__).parents[2] / "golden"
DEFINITIONS = GOLDEN / "definitions"
EXPECTED = GOLDEN / "python"


def generated(*folders: Path) -> dict[str, str]:
    packages = {
        folder.name: [read_definition(path) for path in sorted(folder.glob("*/*.*"))]
        for folder in folders
    }
    return generate(packages, Search(folders))


@pytest.fixture(scope="module")
def demo() -> dict[str, str]:
    return generated(DEFINITIONS / "demo_interfaces")


@pytest.fixture
def importable(demo, tmp_path, monkeypatch):
    """The generated packages, first on the Python path; unloaded after the test."""
    put_all(demo, tmp_path / "out")
    monkeypatch.syspath_prepend(tmp_path / "out")
    packages = {path.split("/")[0] for path in demo}
    yield tmp_path / "out"
    for name in [one for one in sys.modules if one.split(".")[0] in packages]:
        del sys.modules[name]


def test_the_output_is_the_golden_one(demo):
    """Run with UPDATE_GOLDEN=1 after a deliberate change, and review the difference."""
    ours = {
        path: text
        for path, text in demo.items()
        if path.startswith("demo_interfaces/") and not path.endswith("/_runtime.py")
    }
    if os.environ.get("UPDATE_GOLDEN"):
        put_all(ours, EXPECTED)
    golden = {
        path.relative_to(EXPECTED).as_posix(): path.read_text(encoding="utf-8")
        for path in EXPECTED.rglob("*")
        if path.suffix in (".py", ".typed")
    }
    assert ours == golden


def test_the_same_definitions_give_the_same_bytes_in_any_order(demo):
    folder = DEFINITIONS / "demo_interfaces"
    backwards = [read_definition(path) for path in sorted(folder.glob("*/*.*"), reverse=True)]
    again = generate({"demo_interfaces": backwards}, Search([folder]))
    assert list(again.items()) == list(demo.items())


def test_dependencies_are_generated_too(demo):
    """A service's event needs service_msgs, though no definition names it."""
    assert "service_msgs/msg/_service_event_info.py" in demo
    assert "geometry_msgs/msg/_point.py" in demo
    assert "geometry_msgs/msg/_wrench.py" not in demo


def test_every_package_is_typed_and_has_its_own_runtime(demo):
    for package in {path.split("/")[0] for path in demo}:
        assert demo[f"{package}/py.typed"] == ""
        assert demo[f"{package}/_runtime.py"] == demo["demo_interfaces/_runtime.py"]


def test_the_runtime_needs_only_msgspec(demo):
    tree = ast.parse(demo["demo_interfaces/_runtime.py"])
    imported = {
        name.name.split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import)
        for name in node.names
    } | {
        str(node.module).split(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
    }
    assert imported - sys.stdlib_module_names == {"msgspec"}


def test_generated_code_does_not_mention_srvgen_in_an_import(demo):
    assert not [path for path, text in demo.items() if "import srvgen" in text]


def test_generated_packages_can_be_imported_and_pickled(importable):
    module = importlib.import_module("demo_interfaces.msg")
    assert module.__file__ is not None
    assert Path(module.__file__).is_relative_to(importable)
    message = module.Everything(name="Grace", ranges=[1, 2])
    message._check()
    assert pickle.loads(pickle.dumps(message)) == message
    awkward = module.Awkward(**{"from": 3})
    assert pickle.loads(pickle.dumps(awkward)) == awkward


def test_errors_pass_from_one_packages_runtime_to_anothers(importable):
    module = importlib.import_module("demo_interfaces.msg")
    runtime = importlib.import_module("demo_interfaces._runtime")
    message = module.Everything()
    message.point.x = "far"
    with pytest.raises(runtime.FieldError, match=r"^point\.x: expected float64, got 'far'"):
        message._check()


def test_srvgen_encodes_and_converts_messages_of_generated_packages(importable):
    cls = importlib.import_module("demo_interfaces.msg").Everything
    message = cls(ranges=[1, 2], inner={"not": "a message"})
    with pytest.raises(srvgen.FieldError, match=r"^inner: expected"):
        srvgen.to_builtins(message)
    message = srvgen.from_builtins(cls, {"ranges": [1, 2], "inner": {"value": 4}})
    assert srvgen.to_builtins(message)["inner"] == {"value": 4}
    encoder = msgspec.msgpack.Encoder(enc_hook=srvgen._runtime.encode_hook)
    arrived = msgspec.msgpack.Decoder(cls).decode(encoder.encode(message))
    arrived._check()
    assert arrived == message
    with pytest.raises(srvgen.FieldError, match=r"^inner\.value: expected int32, got 'x'"):
        srvgen.from_builtins(cls, {"inner": {"value": "x"}})


def test_services_and_actions_are_imported_as_in_ros(importable):
    tune = importlib.import_module("demo_interfaces.srv").Tune
    assert tune.Request.__module__ == "demo_interfaces.srv._tune"
    count = importlib.import_module("demo_interfaces.action").Count
    assert count.Impl.SendGoalService.Request().goal == count.Goal()
    with pytest.raises(NotImplementedError, match="Service classes can not be instantiated"):
        tune()
    with pytest.raises(NotImplementedError, match="Action classes can not be instantiated"):
        count()


@pytest.fixture
def wrong_lines(demo, tmp_path, mypy):
    """Returns the numbers of the lines of a program in which mypy finds an error."""
    put_all(demo, tmp_path)

    def call(program: str) -> list[str]:
        user = tmp_path / "user.py"
        user.write_text(program, encoding="utf-8")
        found = mypy("--no-error-summary", user, tmp_path / "demo_interfaces")
        errors = [one for one in found if ": error:" in one]
        return [one.partition("user.py:")[2].partition(":")[0] for one in errors]

    return call


@pytest.mark.types
def test_type_checkers_accept_lists_and_know_the_type_that_is_read(wrong_lines):
    program = (
        "from demo_interfaces.msg import Awkward, Everything\n"
        "message = Everything(ranges=[1, 2.5], image=b'12', raw=3, names=['a'])\n"
        "message.covariance = (0.0,) * 9\n"
        "first: float = message.ranges[0]\n"
        "level: bytes = message.raw\n"
        "Everything(rangs=[1])\n"
        "message.image = ['a']\n"
        "Awkward(from_=1, self=2)\n"
    )
    assert wrong_lines(program) == ["6", "7"]


@pytest.mark.types
def test_annotations_can_name_the_messages_of_services_and_actions(wrong_lines):
    program = (
        "from demo_interfaces.action import Count\n"
        "from demo_interfaces.srv import Tune\n"
        "def tune(request: Tune.Request, response: Tune.Response) -> Tune.Response:\n"
        "    response.success = request.value > 0\n"
        "    return response\n"
        "goal: Count.Goal = Count.Impl.SendGoalService.Request().goal\n"
        "tune(Tune.Response(), Tune.Response())\n"
    )
    assert wrong_lines(program) == ["7"]


def test_two_types_that_need_one_module_are_refused(tmp_path):
    folder = tmp_path / "twins" / "msg"
    folder.mkdir(parents=True)
    for name in ("IMU", "Imu"):
        (folder / f"{name}.msg").write_text("int32 a\n", encoding="utf-8")
    if len(list(folder.iterdir())) < 2:
        pytest.skip("this file system does not tell IMU.msg from Imu.msg")
    with pytest.raises(DefinitionError, match=r"got two types for twins/msg/_imu\.py"):
        generated(folder.parent)


@pytest.fixture(scope="module")
def everything(tmp_path_factory) -> Path:
    """All bundled packages, generated."""
    folder = tmp_path_factory.mktemp("bundled")
    put_all(generated(*(one for one in sorted(BUNDLED.iterdir()) if one.is_dir())), folder)
    return folder


@pytest.fixture(scope="module")
def different(everything) -> list[Path]:
    """All generated files; only one copy of the runtime, which is the same in each package."""
    runtimes = sorted(everything.glob("*/_runtime.py"))
    assert len({path.read_bytes() for path in runtimes}) == 1
    return [path for path in sorted(everything.rglob("*.py")) if path not in runtimes[1:]]


@pytest.mark.types
def test_generated_packages_pass_mypy(different, mypy):
    (result,) = mypy("--follow-imports=silent", *different)
    assert result == f"Success: no issues found in {len(different)} source files"


@pytest.mark.types
def test_generated_packages_pass_pyright(tmp_path):
    """Checks modules with each kind of field, default and constant; mypy checks all modules."""
    put_all(generated(DEFINITIONS / "demo_interfaces", BUNDLED / "test_msgs"), tmp_path)
    others = [f"test_msgs/msg/_{name}.py" for name in ("arrays", "strings", "unbounded_sequences")]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pyright",
            "--pythonpath",
            sys.executable,
            "demo_interfaces",
            *others,
        ],
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.stdout.split() == "0 errors, 0 warnings, 0 informations".split()


IMPORTED_ALONE = """\
import sys
from importlib import import_module
from pathlib import Path

import msgspec

before = set(sys.modules)
root = Path(sys.argv[1])
sys.path.insert(0, str(root))
for path in sorted(root.rglob("*.py")):
    import_module(".".join(path.relative_to(root).with_suffix("").parts))
more = {name.partition(".")[0] for name in set(sys.modules) - before}
print(sorted(more - sys.stdlib_module_names) == sorted(one.name for one in root.iterdir()))
"""


def test_generated_code_imports_only_msgspec(everything):
    """In a process of its own, in which every warning is an error."""
    done = subprocess.run(
        [sys.executable, "-I", "-B", "-W", "error", "-c", IMPORTED_ALONE, str(everything)],
        capture_output=True,
        text=True,
    )
    assert (done.stderr, done.stdout) == ("", "True\n")


def test_the_bytes_do_not_depend_on_the_seed_of_hashes(tmp_path):
    call = [sys.executable, "-m", "srvgen", "generate", str(DEFINITIONS / "demo_interfaces"), "-o"]
    call.append(str(tmp_path / "out"))
    root = Path(srvgen.__file__).parents[2]
    for seed, more in (("1", []), ("2", ["--check"]), ("3", ["--check"])):
        done = subprocess.run(
            [*call, *more],
            capture_output=True,
            text=True,
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": str(root)},
        )
        assert done.returncode == 0, done.stdout + done.stderr


class Gone:
    """A test of whether a type is missing; true for the given names."""

    def __init__(self, *names):
        self.names = names

    def __call__(self, name):
        return name in self.names


def test_modules_without_definitions_are_reported_and_removed(tmp_path):
    folder = tmp_path / "out"
    files = {
        f"my_msgs/{kind}/{name}.py": f'"""my_msgs/{kind}/{title}, {GENERATED}"""\n'
        for kind, name, title in [("msg", "_a", "A"), ("msg", "_b", "B"), ("srv", "_c", "C")]
    }
    files |= {f"my_msgs/{kind}/__init__.py": "" for kind in ("msg", "srv")}
    own = '"""my_msgs/msg/B, as I wrote it."""\n'
    assert len(write_tree(files, folder, Gone(), check=False).outdated) == len(files)
    (folder / "my_msgs" / "msg" / "_mine.py").write_text(own)
    del files["my_msgs/msg/_b.py"], files["my_msgs/srv/_c.py"], files["my_msgs/srv/__init__.py"]
    assert write_tree(files, folder, Gone(), check=True) == ([], [], [])
    gone = Gone("my_msgs/msg/B", "my_msgs/srv/C")
    stale = ("my_msgs/msg/_b.py", "my_msgs/srv/_c.py", "my_msgs/srv/__init__.py")
    expected = ([], [folder / path for path in stale], [])
    assert write_tree(files, folder, gone, check=True) == expected
    assert (folder / "my_msgs" / "srv" / "_c.py").exists()
    assert write_tree(files, folder, gone, check=False) == expected
    left = {one.relative_to(folder).as_posix() for one in folder.rglob("*.py")}
    assert left == {*files, "my_msgs/msg/_mine.py"}
    assert write_tree(files, folder, gone, check=True) == ([], [], [])


def test_other_modules_in_the_output_are_kept(tmp_path, monkeypatch, symlink):
    monkeypatch.chdir(tmp_path)
    Path("mine/msg").mkdir(parents=True)
    Path("mine/msg/A.msg").write_text("int32 x\n")
    Path("out/other/msg/_x.py").mkdir(parents=True)
    symlink("out/other/msg/_gone.py", "nowhere")
    assert main(["generate", "mine", "-o", "out"]) == 0
    assert Path("out/other/msg/_x.py").is_dir()
    assert Path("out/mine/msg/_a.py").is_file()
