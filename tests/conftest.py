"""Every async test runs on virtual time, unless it is marked `real_time`."""

from __future__ import annotations

import asyncio
import contextlib
import gc
import os
import shutil
import signal
import sys
from pathlib import Path

import pytest
from hypothesis import settings

from srvgen.classes import loader
from taskrpc.testing import VirtualTimeLoop
from tests import properties
from tests.faults.harness import HAPPENED
from tests.postgres import own_cluster, pgbouncer, postgres_url, shared_cluster  # noqa: F401 - fixtures
from tests.zenoh_routers import zenoh_router  # noqa: F401 - a fixture

WHOLE_RUNS = ("end_to_end", "faults", "hypothesis", "faults or hypothesis or corpus")
"""What `-m` picks in the runs that use all cores, beside the plain run."""
TESTS = Path(__file__).parent
settings.load_profile(properties.ALL)

MOST_PROCESSES = 4
"""More than these gain little: the longest tests wait for programs that they start.

Because they wait, there is one process more than the machine has cores.
"""


def is_plain(config):
    """Whether `-m` picks what pyproject.toml picks."""
    usual = config.getini("addopts")
    return config.option.markexpr == usual[usual.index("-m") + 1]


def pytest_addoption(parser):
    """Options of the fault harnesses in `tests/faults`."""
    group = parser.getgroup("fault harnesses")
    group.addoption("--soak", action="store_true", help="the large sizes: hours")
    group.addoption("--seed", type=int, default=5, help="what chance begins with (5)")


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config):
    """Choose how many processes run the tests.

    A whole run uses all cores, and so does the run of a whole district, such as `tests/core`. Tests
    that the command line picks run in this one process, where a debugger sees them, and try all
    examples of Hypothesis. So does `--soak`, because it measures.
    """
    if "PYTEST_XDIST_WORKER" in os.environ:  # one of those processes must never start more of them
        return
    option = config.option
    picked = option.keyword or option.usepdb or option.trace or option.capture == "no"
    places = [Path(each).resolve() for each in config.args]
    districts = all(each.is_dir() and each.parent == TESTS for each in places)
    whole = (config.args_source is config.ArgsSource.TESTPATHS or districts) and not option.soak
    whole &= is_plain(config) or option.markexpr in WHOLE_RUNS
    option.few_examples = whole and not picked and is_plain(config)
    if whole and not picked and getattr(option, "numprocesses", 0) is None and not option.tx:
        option.numprocesses = min((os.cpu_count() or 1) + 1, MOST_PROCESSES)
        option.dist = "worksteal"


def pytest_ignore_collect(collection_path, config):
    """What the plain run leaves out need not be read either, in each of its processes.

    What needs an extra of its own is read only if `-m` names it. Each mark of such tests has a
    folder of its name in `tests`.
    """
    if collection_path.parent != TESTS:
        return None
    name, marks = collection_path.name, config.option.markexpr
    left_out = is_plain(config) and f"not {name}" in marks.split(" and ")
    left_out |= name in ("browser", "interop", "notebooks") and name not in marks
    return True if left_out else None


class Turned(pytest.Dir):
    """A folder whose contents are read in another order than in xdist's other processes.

    In a fresh environment each process would otherwise compile each module, all at the same time.
    So each one begins elsewhere, and finds the bytecode of the others when it comes to the rest.
    """

    def collect(self):
        found = list(super().collect())
        number = int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw"))
        half = len(found) // 2 if number & 2 else 0
        turned = found[half:] + found[:half]
        return turned[::-1] if number & 1 else turned


def pytest_collect_directory(path, parent):
    """Read folders in an own order in each of xdist's processes."""
    in_a_process = "PYTEST_XDIST_WORKER" in os.environ
    return Turned.from_parent(parent, path=path) if in_a_process else None


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Have the same order of tests in all processes, however they read the folders."""
    items.sort(key=lambda item: item.path.parts)


def pytest_configure(config):
    """Let programs that tests start get SIGINT, even if pytest runs in the background."""
    # A script that starts a process with `&` lets it ignore SIGINT.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    told = getattr(config, "workerinput", None) or vars(config.option)
    if told.get("few_examples"):
        settings.load_profile(properties.QUICK)
    _keep_bytecode(config)


@pytest.hookimpl(optionalhook=True)
def pytest_configure_node(node):
    """Tell xdist's processes what the first process has decided."""
    node.workerinput["few_examples"] = getattr(node.config.option, "few_examples", False)


def _keep_bytecode(config):
    """Compile each module once for all sessions, in this process and in those that it starts.

    Compiling took two thirds of collecting. The bytecode is in pytest's own folder, so it also
    works where the environment allows none beside the sources.
    """
    if cache := getattr(config, "cache", None):
        patch = pytest.MonkeyPatch()
        config.add_cleanup(patch.undo)
        folder = str(cache.mkdir("bytecode"))
        patch.setenv("PYTHONPYCACHEPREFIX", folder)
        patch.delenv("PYTHONDONTWRITEBYTECODE", raising=False)
        patch.setattr(sys, "pycache_prefix", folder)
        patch.setattr(sys, "dont_write_bytecode", False)


def pytest_asyncio_loop_factories(config, item):
    """The virtual clock by default; the machine's for `real_time` tests."""
    if item.get_closest_marker("real_time"):
        # Windows' other loop starts no processes; programs there use this one, too.
        is_windows = sys.platform == "win32"
        return {"real": asyncio.ProactorEventLoop if is_windows else asyncio.SelectorEventLoop}
    return {"virtual": VirtualTimeLoop}


def pytest_terminal_summary(terminalreporter):
    """Tell what really happened in the tests that count it; their processes have no terminal."""
    reports = [
        report for kind in ("passed", "failed") for report in terminalreporter.getreports(kind)
    ]
    told = [(each, dict(each.user_properties)) for each in reports if each.when == "call"]
    if told := [(each.location[2], said[HAPPENED]) for each, said in told if HAPPENED in said]:
        terminalreporter.section("what happened")
        for name, counts in told:
            terminalreporter.line(f"{name}: {counts}")


def pytest_collection():
    """Whatever collecting makes lives to the end: no collection of garbage walks it."""
    gc.disable()


def pytest_collection_finish():
    """From here on garbage is collected, but never among what collecting has made."""
    gc.enable()
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item, nextitem):
    """Collect the garbage of a file's tests, and never again walk what they leave on purpose.

    Imported modules, loaded message classes and reports live to the end. Without this, they take
    most of the time of tests that collect garbage.
    """
    ended = yield
    if nextitem is None or nextitem.path != item.path:
        gc.collect()
        gc.freeze()
    return ended


@pytest.fixture(scope="session", autouse=True)
def _no_bytecode_of_temporary_programs(tmp_path_factory):
    """What tests wrote into temporary folders leaves no bytecode for the next sessions."""
    yield
    if bytecode := os.environ.get("PYTHONPYCACHEPREFIX"):
        base = tmp_path_factory.getbasetemp()
        folder = Path(bytecode) / base.relative_to(base.anchor)
        shutil.rmtree(folder, ignore_errors=True)
        with contextlib.suppress(OSError):
            folder.parent.rmdir()  # the last process of a session can


@pytest.fixture(scope="session")
def _empty_places(tmp_path_factory):
    """Return a function that gives two empty folders: the same ones while they stay empty.

    Most tests leave nothing, and to make and remove folders for each took seconds.
    """
    places: list[Path] = []

    def empty():
        if not places or any(os.listdir(place) for place in places):
            folder = tmp_path_factory.mktemp("places")
            places[:] = folder / "runtime", folder / "state"
            for place in places:
                place.mkdir(mode=0o700)
        return places

    return empty


@pytest.fixture(autouse=True)
def _private_places(_empty_places, monkeypatch):
    """No test sees, or leaves anything in, the user's own runtime and state folders."""
    runtime, state = _empty_places()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.setenv("XDG_STATE_HOME", str(state))
    # Programs that tests start run the same code as the tests, installed or not.
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[1]))
    own = ("TASKRPC_PEERS", "TASKRPC_TOKEN", "TASKRPC_INTERFACE_PATH", "TASKRPC_KEEPALIVE")
    for name in ("ROS_DOMAIN_ID", *own):
        monkeypatch.delenv(name, raising=False)


@pytest.fixture
def symlink():
    """Makes a symbolic link; skips the test where the system lets only administrators make any."""

    def make(link, target):
        try:
            Path(link).symlink_to(target, target_is_directory=Path(target).is_dir())
        except OSError:
            if sys.platform != "win32":
                raise
            pytest.skip("Windows lets only administrators and developers make symbolic links")

    return make


@pytest.fixture
def ros_classes(monkeypatch):
    """The loader makes classes for programs for ROS, and none that earlier tests have loaded."""
    monkeypatch.setattr(loader, "_runtime_module", loader._runtime_module)
    monkeypatch.setattr(loader, "_built", {})
    monkeypatch.setattr(loader, "_loaded", {})
    loader.make_ros_classes()
