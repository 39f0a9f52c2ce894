"""Submissions that attack what is beside them: files, sockets, memory, other students' work."""

import ctypes
import os
import socket
import stat
import tempfile
import textwrap
from pathlib import Path

import pytest

from taskrpc.course.labs.grader import grade, grade_all
from taskrpc.course.labs.sandbox.worker import Request
from taskrpc.course.labs.variants import Variant
from tests.labs.confined import needs_bubblewrap
from tests.labs.submissions import solution_of, submission

pytestmark = [pytest.mark.labs, pytest.mark.real_time, needs_bubblewrap]

HIDDEN = """
import os
from taskrpc.course.labs.lab import Check, NotMet

async def run(trial):
    before = os.sched_getaffinity(0)
    program = await trial.start("server.py")
    said = await program.wait_for_line("did: (.*)", 20)
    output = said[1] if said else " / ".join(program.output)[-600:]
    if os.sched_getaffinity(0) != before:
        output = "the checks have other processors"
    await trial.start("client.py", "1", "2")
    raise NotMet("", output, "")

CHECKS = (Check("hidden", 2, run),)
"""
PREPARED = """
import os, sys, time
guard = sys.modules.get("taskrpc.course.labs.sandbox.guard")  # a guard in Python stops nobody
for name in [name for name in vars(guard) if name.startswith("_check")] if guard else []:
    setattr(guard, name, lambda *_: None)

def tried(action):
    try:
        return action()
    except Exception as error:
        return f"{type(error).__name__}: {error}"

"""
WAIT = "\nwhile True: time.sleep(1)\n"


@pytest.fixture
def place():
    """A folder with a short path, for Unix sockets, that every user can enter."""
    with tempfile.TemporaryDirectory(dir="/tmp") as folder:
        os.chmod(folder, 0o755)
        yield Path(folder)


async def outcome(place, code, **values):
    """Grade a submission whose server runs this code; returns what the code says that it did."""
    hidden = place / "lecturer" / "lab1" / "hidden.py"
    hidden.parent.mkdir(parents=True)
    hidden.write_text(HIDDEN)
    source = place / "ada"
    submission(1, solution_of(1), source, Variant())
    assigned = "".join(f"{name} = {str(value)!r}\n" for name, value in values.items())
    (source / "server.py").write_text(PREPARED + assigned + textwrap.dedent(code) + WAIT)
    found = await grade(Request(str(source), hidden=str(place / "lecturer"), confined=True), "ada")
    assert found.stopped == ""
    last = found.results[-1]
    return " ".join([last.expected, last.happened, last.look]).strip()


async def test_a_socket_outside_cannot_be_reached(place):
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(place / "runner.sock"))
        server.listen()
        os.chmod(place / "runner.sock", 0o777)
        code = """
            import socket
            print("did:", tried(lambda: socket.socket(socket.AF_UNIX).connect(path)), flush=True)
        """
        did = await outcome(place, code, path=place / "runner.sock")
        server.setblocking(False)
        with pytest.raises(BlockingIOError):
            server.accept()
    assert did == "FileNotFoundError: [Errno 2] No such file or directory"


LINKED_REGISTRY = """
def link():
    for folder, names, _ in os.walk(os.environ["XDG_RUNTIME_DIR"]):
        for name in names:
            if name.startswith("domain_"):
                os.rename(f"{folder}/{name}", f"{folder}/{name}.old")
                os.symlink(path, f"{folder}/{name}")
print("did:", tried(link), flush=True)
"""


async def test_files_are_not_deleted_through_a_link_at_the_place_of_the_registry(place):
    victim = place / "victim"
    victim.mkdir()
    (victim / "settings.json").write_text("{}")
    await outcome(place, LINKED_REGISTRY, path=victim)
    assert [each.name for each in victim.iterdir()] == ["settings.json"]


async def test_no_line_of_another_file_is_shown_through_a_link(place):
    (place / "secret").write_text("secret = swordfish (\n")
    code = """
        def link():
            os.remove("client.py")
            os.symlink(path, "client.py")
        print("did:", tried(link), flush=True)
    """
    assert "swordfish" not in await outcome(place, code, path=place / "secret")


async def test_the_mode_of_another_file_cannot_be_changed(place):
    (place / "file").touch(mode=0o644)
    code = """
        def change():
            home = os.environ["HOME"]
            os.symlink(path, f"{home}/link")
            os.chmod("link", 0o777, dir_fd=os.open(home, os.O_RDONLY))
        print("did:", tried(change), flush=True)
    """
    did = await outcome(place, code, path=place / "file")
    assert did.startswith("FileNotFoundError")
    assert stat.S_IMODE((place / "file").stat().st_mode) == 0o644


@pytest.mark.skipif(len(os.sched_getaffinity(0)) < 2, reason="needs two processors")
async def test_the_checks_keep_their_processors(place):
    code = """
        def pin():
            last = max(os.getpid(), os.getppid())
            for pid in range(max(1, last - 9999), last + 9):
                try: os.sched_setaffinity(pid, {0})
                except OSError: pass
        print("did:", tried(pin), flush=True)
    """
    assert await outcome(place, code) == "None"


async def test_unlinked_files_hold_little(place):
    code = """
        import resource
        def hold():
            for folder in ("tmp", "HOME", "TMPDIR", "XDG_RUNTIME_DIR", "/dev/shm", "/", "/dev"):
                folder = os.environ.get(folder, folder)
                for number in range(200):
                    try:
                        file = os.open(f"{folder}/file", os.O_RDWR | os.O_CREAT, 0o600)
                        os.unlink(f"{folder}/file")
                        for _ in range(9):
                            held.append(os.write(file, bytes(2**20)))
                    except OSError:
                        break
        held = []
        tried(hold)
        print("did:", sum(held) >> 20, flush=True)
    """
    assert int(await outcome(place, code)) <= 50


async def test_few_threads_can_be_started(place):
    code = """
        import threading
        threading.stack_size(2**16)
        def start():
            for number in range(3000):
                threading.Thread(target=time.sleep, args=(1e6,), daemon=True).start()
        tried(start)
        print("did:", threading.active_count(), flush=True)
    """
    assert int(await outcome(place, code)) <= 300


async def test_few_processes_can_be_started(place):
    code = """
        def start():
            for number in range(3000):
                if os.fork() == 0:
                    time.sleep(1e6)
                started.append(number)
        started = []
        tried(start)
        print("did:", len(started), flush=True)
    """
    did = await outcome(place, code)  # so many hold too much memory
    assert "more than 1024 MB of memory" in did or int(did) <= 300


async def test_shared_memory_of_other_programs_cannot_be_attached(place):
    libc = ctypes.CDLL(None, use_errno=True)
    segment = libc.shmget(0, 4096, 0o1666)
    assert segment >= 0
    try:
        code = """
            import ctypes
            libc = ctypes.CDLL(None, use_errno=True)
            libc.shmat.restype = ctypes.c_void_p
            print("did:", libc.shmat(int(segment), None, 0) == 2**64 - 1, flush=True)
        """
        assert await outcome(place, code, segment=segment) == "True"
    finally:
        libc.shmctl(segment, 0, None)


@pytest.mark.parametrize("call", ["shmget(0, 600 << 20, 0o1600)", "syscall(319, b'x', 0)"])
async def test_no_memory_without_a_limit_can_be_made(place, call):
    code = """
        import ctypes
        libc = ctypes.CDLL(None, use_errno=True)
        print("did:", eval(f"libc.{call}"), flush=True)
    """
    assert await outcome(place, code, call=call) == "-1"


async def test_the_programs_of_a_check_share_a_limit_of_memory(place):
    code = """
        for _ in range(8):
            if os.fork() == 0:
                memory = bytearray(500 << 20)
                for at in range(0, len(memory), 4096):
                    memory[at] = 1
                time.sleep(1e6)
        time.sleep(1e6)
    """
    assert "more than 1024 MB of memory" in await outcome(place, code)


async def test_a_submission_cannot_touch_that_of_another_student(place):
    for name in ("ada", "bob"):
        submission(1, solution_of(1), place / "all" / name, Variant())
    code = """
        def attack():
            import glob, shutil, signal, socket
            for line in open("/proc/net/unix").read().splitlines()[1:]:
                name = line.split()[-1]
                tried(lambda: socket.socket(socket.AF_UNIX).connect(name))
            for each in glob.glob("/tmp/taskrpc-lab-*"):
                tried(lambda: shutil.rmtree(each))
            tried(lambda: shutil.rmtree(path))
            for pid in range(2, 2**16):
                if pid != os.getpid():
                    try: os.kill(pid, signal.SIGKILL)
                    except OSError: pass
    """
    attack = f"{PREPARED}\npath = {str(place / 'all' / 'bob')!r}\n{textwrap.dedent(code)}\n"
    linked = LINKED_REGISTRY.replace("print(", "(")
    (place / "all" / "ada" / "server.py").write_text(f"{attack}\ntried(attack)\n{linked}\n{WAIT}")
    before = sorted(each.name for each in (place / "all" / "bob").iterdir())
    sources = sorted((place / "all").iterdir())
    found = {
        each.student: each
        async for _, each in grade_all(
            sources, lambda source: Request(str(source), confined=True), 2
        )
    }
    assert sorted(each.name for each in (place / "all" / "bob").iterdir()) == before
    assert (found["bob"].points, found["bob"].stopped) == (10, "")
    assert found["ada"].points < 5
