"""The start of each program under check: clock and limits first, then the student's file.

On POSIX `supervisor` calls `run` in a process that has imported everything; on Windows
`boot.command` starts this module. A simulated program gets a new Python instead: see `simulated`.
"""

from __future__ import annotations

import os
import signal
import sys
import tempfile
from pathlib import Path

import msgspec

from taskrpc.course.labs.sandbox import boot, interleaving, speed
from taskrpc.course.labs.sandbox.limits import CONFINED, LIMITS, limit_this_process
from taskrpc.course.labs.sandbox.simulated.messages import Plan


class Start(msgspec.Struct, frozen=True):
    """A program to start.

    Attributes:
        file: its path in the folder of the submission.
        arguments: of its command line.
        scratch: the folder of this check, in which the program has its home and temporary folder.
        folder: the folder in which it runs, with the files of the submission.
        confined: whether it runs in a sandbox.
        speed: how much faster its time passes.
        wall: the wall clock of the process that checks: see `speed.set_speed`.
        interleaved: whether its callbacks take turns at each step: see `interleaving`.
        ready: a file to make once everything is imported; "" for none.
        plan: what to simulate it with; None to run it in time that passes.
    """

    file: str
    arguments: tuple[str, ...]
    scratch: str = ""
    folder: str = ""
    confined: bool = False
    speed: float = 1.0
    wall: tuple[int, int] | None = None
    interleaved: bool = False
    ready: str = ""
    plan: Plan | None = None


def environment(scratch: Path) -> dict[str, str]:
    """Return all variables that a program under check sees, and make the folders they name."""
    folders = {"HOME": "home", "TMPDIR": "tmp", "XDG_RUNTIME_DIR": "run"}
    for name in folders.values():
        (scratch / name).mkdir(mode=0o700, exist_ok=True)
    env = {variable: str(scratch / name) for variable, name in folders.items()}
    env |= {"XDG_STATE_HOME": env["HOME"], "XDG_CACHE_HOME": env["HOME"]}
    env |= {"NO_COLOR": "1", "OPENBLAS_NUM_THREADS": "1"}
    if sys.platform == "win32":
        env |= dict.fromkeys(("TEMP", "TMP"), env["TMPDIR"])
        env |= dict.fromkeys(("USERPROFILE", "APPDATA", "LOCALAPPDATA"), env["HOME"])
    return system_environment() | env


def system_environment() -> dict[str, str]:
    """Return the variables that Python itself needs, and none of the user's."""
    env = {"PATH": os.defpath, "PYTHONUTF8": "1", "PYTHONHASHSEED": "0", "LC_ALL": "C.UTF-8"}
    if sys.platform == "win32":
        kept = ("SYSTEMROOT", "WINDIR", "PATH", "COMSPEC", "NUMBER_OF_PROCESSORS", "TEMP", "TMP")
    else:
        kept = ("TMPDIR",)
    return env | {name: os.environ[name] for name in kept if name in os.environ}


def run(start: Start) -> int:
    """Limit this process, and run the program in it; returns its exit code."""
    from taskrpc.errors import TaskRpcError
    from taskrpc.ros import runner

    os.environ.clear()
    os.environ.update(environment(Path(start.scratch)))
    os.chdir(start.folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)
    if start.plan is not None:
        command = boot.command(boot.SIMULATED, msgspec.json.encode(start).decode())
        os.execv(command[0], command)
    sys.dont_write_bytecode = True
    tempfile.tempdir = None  # found again, in the new environment
    speed.set_speed(start.speed, start.wall)
    for stream in (sys.stdout, sys.stderr):
        # As on a terminal: the checks see each line when the program writes it.
        stream.reconfigure(line_buffering=True, errors="backslashreplace")  # type: ignore[union-attr]
    if start.interleaved:
        interleaving.install(Path(start.file).resolve().parent)
    limit_this_process(CONFINED if start.confined else LIMITS)
    try:
        return runner.run_script(Path(start.file), start.arguments)
    except TaskRpcError as error:
        print("\n  hint: ".join([str(error), *getattr(error, "__notes__", ())]), file=sys.stderr)
        return 1


def preload() -> None:
    """Import what the programs of the labs import; starts no thread."""
    from importlib import import_module

    from taskrpc.ros import hook

    hook.install()
    for name in (
        *("rclpy", "rclpy.node", "rclpy.executors", "rclpy.callback_groups", "rclpy.action"),
        *("rclpy.qos", "rclpy.parameter", "rclpy.duration", "rclpy.time"),
        *("example_interfaces.srv", "std_srvs.srv", "std_msgs.msg"),
        *("taskrpc.ros.runner", "taskrpc.core.transport.tcp.listening"),
        *("queue", "traceback", "random"),
    ):
        import_module(name)


def main(request: str) -> int:
    """Run the program of a request; the entry point on Windows."""
    start = msgspec.json.decode(request, type=Start)
    preload()
    Path(start.ready).touch()
    return run(start)
