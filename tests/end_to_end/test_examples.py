"""Every example runs as its README says, and prints what its README shows.

A README's table gives the commands, terminal by terminal; the `text` blocks after it show in the
same order what each prints; `console` blocks show a command and its output while the servers of
the table run, or, under "Without the server", when they do not. `...` stands for any lines.
"""

import ast
import atexit
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path

import pytest

pytestmark = [pytest.mark.end_to_end, pytest.mark.real_time]

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
FOLDERS = sorted(path.name for path in EXAMPLES.iterdir() if path.name[:1].isdigit())
SCRIPTS = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["scripts"]
PATIENCE = 60.0  # seconds; reached only by a failing test

# The READMEs show slow programs; these arguments make them quick.
QUICK = {
    "examples/03_robot_task/task_server.py": ["100"],
    "examples/04_sync_and_async/server.py": ["0.2"],
    "examples/05_timeouts/server.py": ["0.8"],
    "examples/05_timeouts/client.py": ["5", "0.4"],
    "examples/06_retry_with_backoff/client.py": ["0.08"],
    "examples/07_concurrent_requests/server.py": ["0.06"],
    "examples/09_actions/server.py": ["0.02"],
    "taskrpc-server": ["--speed", "100", "--fresh"],
}
# Requests that run at the same time may print their lines in any order.
UNORDERED = {"04_sync_and_async"}


@dataclass
class Scene:
    """A table of commands with what they print, and the console blocks that follow it."""

    commands: list[tuple[str, str, str]]  # terminal, command, the command in Windows' spelling
    shown: list[str] = field(default_factory=list)
    beside: list[tuple[str, str]] = field(default_factory=list)  # command, output
    alone: list[tuple[str, str]] = field(default_factory=list)


@dataclass
class Outcome:
    """The recorded results of a scene."""

    printed: list[str]
    beside: list[str]
    alone: list[str]
    exit_codes: list[int]  # of the programs in terminal 1, after Ctrl-C


def scenes_of(folder):
    text = (EXAMPLES / folder / "README.md").read_text("utf-8")
    scenes = []
    for part in re.split(r"(?=\| terminal \| Linux, macOS \| Windows \|)", text)[1:]:
        commands = re.findall(r"^\| (\d) \| `(.+?)` \| `(.+?)` \|$", part, re.MULTILINE)
        scene = Scene(commands)
        heading = ""
        for match in re.finditer(
            r"^## ([^\n]+)$|^```(text|console)\n(.*?)^```$", part, re.M | re.S
        ):
            title, kind, body = match.groups()
            if title:
                heading = title
            elif kind == "text" and len(scene.shown) < len(commands):
                scene.shown.append(body)
            elif kind == "console":
                pairs = scene.alone if heading == "Without the server" else scene.beside
                pairs += console_pairs(body)
        scenes.append(scene)
    return scenes


def console_pairs(body):
    return [tuple(pair.split("\n", 1)) for pair in re.split(r"^\$ ", body, flags=re.M)[1:]]


def argv_of(command, *, quick):
    """The command as a list, in which `python` and the commands of this project are real."""
    first, *rest = shlex.split(command)
    if first == "python":
        program, *rest = rest
        head = [sys.executable, program]
    else:
        program = first
        module, function = SCRIPTS[first].split(":")
        code = f"import sys; from {module} import {function} as main; sys.argv[0] = {first!r}"
        head = [sys.executable, "-c", f"{code}; sys.exit(main())"]
    return head + (QUICK.get(program, rest) if quick else rest)


@contextmanager
def private_network():
    """The environment of programs that see only each other."""
    with tempfile.TemporaryDirectory() as folder:
        places = ("XDG_RUNTIME_DIR", "XDG_STATE_HOME", "OUTPUTS")
        for name in places:
            Path(folder, name).mkdir(mode=0o700)
        own = {
            **{name: str(Path(folder, name)) for name in places},
            "PYTHONPATH": str(ROOT),
            "PYTHONUNBUFFERED": "1",
            "PYTHONUTF8": "1",
            "NO_COLOR": "1",
            "COLUMNS": "80",
        }
        others = {
            name: value
            for name, value in os.environ.items()
            if name != "ROS_DOMAIN_ID" and not name.startswith("TASKRPC_")
        }
        yield {**others, **own}


class Running:
    """A program in the background, as in another terminal."""

    def __init__(self, argv, *, cwd, env):
        descriptor, name = tempfile.mkstemp(dir=env["OUTPUTS"])
        self.output = Path(name)
        group = {"creationflags": subprocess.CREATE_NEW_PROCESS_GROUP} if os.name == "nt" else {}
        try:
            self.process = subprocess.Popen(
                argv, cwd=cwd, env=env, stdout=descriptor, stderr=subprocess.STDOUT, **group
            )
        finally:
            os.close(descriptor)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.wait()

    def text(self):
        return self.output.read_bytes().decode("utf-8").replace("\r\n", "\n")

    def wait_until(self, is_there):
        """Wait until the output satisfies `is_there`, or give up; returns the output."""
        end = time.monotonic() + PATIENCE
        while not is_there(self.text()) and time.monotonic() < end and self.process.poll() is None:
            time.sleep(0.01)  # the process writes to a file, which cannot wake us
        return self.text()

    def press_ctrl_c(self):
        # Windows can send a process of another group only Ctrl-Break; programs handle it alike.
        key = signal.CTRL_BREAK_EVENT if os.name == "nt" else signal.SIGINT
        self.process.send_signal(key)
        return self.process.wait(PATIENCE)


@cache
def stage():
    """A folder with a copy of the examples, so that nothing is written into the checkout."""
    folder = tempfile.TemporaryDirectory(prefix="taskrpc-examples-")
    atexit.register(folder.cleanup)
    shutil.copytree(EXAMPLES, Path(folder.name, "examples"))
    return Path(folder.name)


def run(command, env, *, quick=False, cwd=None):
    """Run a command to its end; returns what it printed."""
    done = subprocess.run(
        argv_of(command, quick=quick),
        cwd=cwd or stage(),
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=PATIENCE,
        check=False,
    )
    return done.stdout.decode("utf-8").replace("\r\n", "\n")


def start(command, env):
    """Start what a README runs in terminal 1; a script from its own folder, as the other way."""
    argv = argv_of(command, quick=True)
    if argv[1] == "-c":
        return Running(argv, cwd=stage(), env=env)
    script = stage() / argv[1]
    return Running([argv[0], script.name, *argv[2:]], cwd=script.parent, env=env)


def play(scene):
    """Do what a README says, from the first command to Ctrl-C."""
    with private_network() as env, ExitStack() as stack:
        printed, servers = [], []
        for (terminal, command, _), shown in zip(scene.commands, scene.shown, strict=True):
            if terminal == "1":
                server = stack.enter_context(start(command, env))
                ready = plain(shown).splitlines()[0]
                server.wait_until(lambda text, line=ready: line in plain(text))
                servers.append((server, shown))
                printed.append("")
            else:
                printed.append(run(command, env, quick=True))
        for number, (server, shown) in enumerate(servers):
            printed[number] = server.wait_until(lambda text, all=shown: agree(text, all))
        beside = [run(command, env) for command, _ in scene.beside]
        exit_codes = [server.press_ctrl_c() for server, _ in servers]
        alone = [run(command, env) for command, _ in scene.alone]
        return Outcome(printed, beside, alone, exit_codes)


@pytest.fixture(scope="module")
def outcomes_of():
    """The outcomes of a README's scenes, played once for all tests, two READMEs at a time."""
    with ThreadPoolExecutor(2) as threads:
        played = {
            folder: threads.submit(lambda name=folder: [play(one) for one in scenes_of(name)])
            for folder in FOLDERS
        }
        yield lambda folder: played[folder].result()
        threads.shutdown(cancel_futures=True)


def plain(text):
    """Return text without the parts that differ between runs: figures, process ids, paths."""
    for pattern, replacement in (
        (r"\\", "/"),  # in paths of Windows
        (r"127\.0\.0\.1:\d+", "HOST:PORT"),
        (r"\d+\.\d+", "#.#"),
        (r"\bpid \d+|(?<=_cli_)\d+|(?<=taskrpc stop )\d+", "PID"),
        (r"\d\d:\d\d:\d\d", "TIME"),
        (r"(?<=, in ).+?(?=, since|\))", "FOLDER"),
        (r"(?m)^\d+ +TIME( +\d+ +\w+\.py ).+? (?=/add )", r"PID TIME\1 FOLDER "),
        (r"  +", "  "),  # columns are as wide as what stands in them
        (r'File ".*?(\w+\.py)", line \d+', r'File "\1", line N'),
    ):
        text = re.sub(pattern, replacement, text)
    return text


def agree(printed, shown):
    """Whether a program printed what the README shows; `…` stands for any part of a line."""
    lines = plain(shown).splitlines(keepends=True)
    pattern = "".join(
        r"(?:.*\n)*?" if line == "...\n" else re.escape(line).replace("…", ".*") for line in lines
    )
    return re.fullmatch(pattern, plain(printed)) is not None


def check_same(printed, shown, folder):
    if folder in UNORDERED:
        printed, shown = ("".join(sorted(text.splitlines(True))) for text in (printed, shown))
    if not agree(printed, shown):
        assert plain(printed) == plain(shown)


def figures(text, pattern):
    return [float(number) for number in re.findall(pattern, text)]


# What every README promises


@pytest.mark.parametrize("folder", FOLDERS)
def test_programs_print_the_output_in_their_readme(folder, outcomes_of):
    for scene, outcome in zip(scenes_of(folder), outcomes_of(folder), strict=True):
        for printed, shown in zip(outcome.printed, scene.shown, strict=True):
            check_same(printed, shown, folder)


@pytest.mark.parametrize("folder", FOLDERS)
def test_suggested_experiments_print_the_output_in_the_readme(folder, outcomes_of):
    for scene, outcome in zip(scenes_of(folder), outcomes_of(folder), strict=True):
        for printed, (_, shown) in zip(outcome.beside, scene.beside, strict=True):
            check_same(printed, shown, folder)
        for printed, (_, shown) in zip(outcome.alone, scene.alone, strict=True):
            check_same(printed, shown, folder)


@pytest.mark.parametrize("folder", FOLDERS)
def test_readme_suggests_an_experiment(folder):
    assert any(scene.beside + scene.alone for scene in scenes_of(folder))


@pytest.mark.parametrize("folder", FOLDERS)
def test_ctrl_c_ends_scripts_with_0_and_the_server_command_as_documented(folder, outcomes_of):
    interrupted = 0 if os.name == "nt" else 130  # Windows gets Ctrl-Break instead of Ctrl-C
    for scene, outcome in zip(scenes_of(folder), outcomes_of(folder), strict=True):
        servers = [command for terminal, command, _ in scene.commands if terminal == "1"]
        expected = [interrupted if one.startswith("taskrpc-server") else 0 for one in servers]
        assert servers
        assert outcome.exit_codes == expected


@pytest.mark.parametrize("folder", FOLDERS)
def test_readme_commands_name_files_that_exist_in_both_spellings(folder):
    scenes = scenes_of(folder)
    assert scenes
    for scene in scenes:
        for _, command, on_windows in scene.commands:
            words = command.split(" ")
            spelt = [word.replace("/", "\\") if "examples/" in word else word for word in words]
            assert on_windows == " ".join(spelt)
        commands = [command for _, command, _ in scene.commands]
        for command in commands + [command for command, _ in scene.beside + scene.alone]:
            first, *rest = shlex.split(command)
            assert first == "python" or first in SCRIPTS
            for argument in rest:
                assert not argument.startswith("examples") or (ROOT / argument).exists()


@pytest.mark.parametrize("folder", FOLDERS)
def test_each_program_has_a_main_and_is_in_its_readme(folder):
    programs = list((EXAMPLES / folder).glob("*.py"))
    assert programs
    for program in programs:
        names = {getattr(node, "name", "") for node in ast.parse(program.read_text("utf-8")).body}
        assert "main" in names
        assert program.name in (EXAMPLES / folder / "README.md").read_text("utf-8")


def test_index_links_every_example():
    index = (EXAMPLES / "README.md").read_text("utf-8")
    assert re.findall(r"\]\((\d\d_\w+)/\)", index) == FOLDERS


# What single examples promise


def test_01_client_that_starts_first_waits_for_the_server():
    with private_network() as env:
        client = argv_of("python examples/01_add_two_ints/client.py 2 3", quick=False)
        with Running(client, cwd=stage(), env=env) as client:
            client.wait_until(lambda text: "waiting" in text)
            with start("python examples/01_add_two_ints/server.py", env):
                assert client.process.wait(PATIENCE) == 0
            *waiting, last = client.text().splitlines()
        assert set(waiting) == {"waiting for /add_two_ints ... is server.py running?"}
        assert last == "2 + 3 = 5"


def test_02_srvgen_reports_a_mistyped_definition_as_in_the_readme(tmp_path):
    example = "examples/02_custom_service"
    shutil.copytree(ROOT / example, tmp_path / example)
    definition = tmp_path / example / "my_interfaces/srv/CheckScan.srv"
    text = definition.read_text("utf-8")
    definition.write_text(text.replace("float64[]", "float[]", 1), "utf-8")
    with private_network() as env:
        said = run(f"srvgen check {example}/my_interfaces", env, cwd=tmp_path)
    assert said.replace("\\", "/") in (EXAMPLES / "02_custom_service/README.md").read_text("utf-8")


def test_02_generated_classes_replace_the_import_hook(tmp_path):
    with private_network() as env:
        run(
            f"srvgen generate examples/02_custom_service/my_interfaces -o {tmp_path.as_posix()}",
            env,
        )
        code = "from my_interfaces.srv import CheckScan as C; print(C.Response.STOP, C.__module__)"
        env["PYTHONPATH"] = str(tmp_path)
        printed = subprocess.check_output([sys.executable, "-c", code], env=env, text=True)
    assert printed == "2 my_interfaces.srv._check_scan\n"


def test_02_client_with_another_definition_is_refused(tmp_path):
    example = "examples/02_custom_service"
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / example, copy)
    definition = copy / "my_interfaces/srv/CheckScan.srv"
    definition.write_text("string room\n" + definition.read_text("utf-8"), "utf-8")
    with private_network() as env, start(f"python {example}/server.py", env) as server:
        server.wait_until(lambda text: "ready" in text)
        said = run("python client.py 1", env, cwd=copy)
    assert "/check_scan is offered as my_interfaces/srv/CheckScan with the hash" in said


def test_04_four_concurrent_calls_take_as_long_as_one(outcomes_of):
    (outcome,) = outcomes_of("04_sync_and_async")
    (one_by_one,) = figures(outcome.printed[1], r"took (\S+) s")
    (together,) = figures(outcome.printed[2], r"took (\S+) s")
    assert one_by_one >= 4 * 0.2
    assert 0.2 <= together < 4 * 0.2  # one by one they cannot be faster, on any machine


def test_05_call_ends_at_its_deadline_and_not_before(outcomes_of):
    (outcome,) = outcomes_of("05_timeouts")
    whole, late, quick = figures(outcome.printed[1], r"after (\S+) s")
    assert whole >= 0.8
    assert 0.4 <= late < whole
    assert quick < whole


def test_06_lecture_policy_waits_as_long_as_the_loop_and_the_default_less(outcomes_of):
    (outcome,) = outcomes_of("06_retry_with_backoff")
    by_hand, lecture, default = figures(outcome.printed[1], r"degrees after (\S+) s")
    assert by_hand >= 3 * 0.08
    assert lecture >= 3 * 0.08
    assert default < lecture


def test_07_concurrency_and_threads_shorten_eight_requests(outcomes_of):
    (outcome,) = outcomes_of("07_concurrent_requests")
    one_by_one, at_once, threads = figures(outcome.printed[1], r"in (\S+) s")
    assert one_by_one >= 8 * 0.06
    assert at_once < one_by_one / 2
    assert threads < one_by_one / 2


def test_07_callback_that_blocks_the_loop_is_named_as_in_the_readme():
    folder = "examples/07_concurrent_requests"
    with private_network() as env:
        server = Running([sys.executable, "server.py", "0.3"], cwd=stage() / folder, env=env)
        with server:
            server.wait_until(lambda text: "ready" in text)
            client = argv_of(f"python {folder}/client.py holding", quick=False)
            with Running(client, cwd=stage(), env=env):
                said = server.wait_until(lambda text: "held" in text)
    warning = plain(said.splitlines()[-1])
    assert "/holding held the event loop" in warning
    assert warning in plain((ROOT / folder / "README.md").read_text("utf-8"))


def test_08_log_and_taskrpc_stop_print_as_in_the_readme():
    folder = "examples/08_debugging"
    readme = plain((ROOT / folder / "README.md").read_text("utf-8"))
    with private_network() as env, start(f"python {folder}/server.py", env) as server:
        server.wait_until(lambda text: "ready" in text)
        run("taskrpc-call /forgets_return a=2 b=3", env)
        (reason,) = re.findall("TypeError.*", server.text())
        assert reason in readme
        assert plain(run("taskrpc stop server.py", env)) in readme
        assert server.process.wait(PATIENCE) is not None
