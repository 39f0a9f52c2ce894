"""A real PostgreSQL for tests: a cluster of its own in a temporary folder."""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import pytest

_USER = "taskrpc"


def _programs() -> Path | None:
    """The folder of initdb and postgres: Debian's newest, or that of the PATH."""
    found = sorted(Path("/usr/lib/postgresql").glob("*/bin/initdb"), key=_version)
    if found:
        return found[-1].parent
    on_path = shutil.which("initdb")
    return Path(on_path).parent if on_path else None


def _version(program: Path) -> float:
    return float(program.parts[-3])


def why_missing() -> str:
    """Why no test can use PostgreSQL here, "" if tests can."""
    try:
        import psycopg  # noqa: F401
    except ImportError:
        return "psycopg is not installed: pip install 'psycopg[binary]'"
    if sys.platform == "win32" or _programs() is None:
        return "PostgreSQL is not installed: apt-get install postgresql"
    return ""


def _descendants(ancestor: int) -> list[int]:
    """Return the processes that a process has started, and those that they have started."""
    listed = subprocess.run(["ps", "-A", "-o", "pid=,ppid="], capture_output=True, check=True)
    children: dict[int, list[int]] = {}
    for line in listed.stdout.splitlines():
        process, parent = map(int, line.split())
        children.setdefault(parent, []).append(process)
    found = [ancestor]
    for each in found:  # the list grows
        found += children.get(each, ())
    return found[1:]


class Cluster:
    """A PostgreSQL server on a free port of 127.0.0.1; tests start, stop and kill it."""

    def __init__(self) -> None:
        programs = _programs()
        assert programs is not None, why_missing()
        self._programs = programs
        # Not in pytest's folders: PostgreSQL refuses to run as root, and its own user cannot
        # enter them.
        self.folder = Path(tempfile.mkdtemp(prefix="taskrpc-postgres-"))
        if os.geteuid() == 0:
            shutil.chown(self.folder, "postgres")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self._made = 0
        data = self.folder / "data"
        self._run("initdb", "-D", data, "-A", "trust", "-U", _USER, "-E", "UTF8", "--no-sync")
        self.process: subprocess.Popen[bytes] | None = None

    def start(self, *, fsync: bool = True) -> None:
        """Start the server and wait until it accepts connections."""
        settings = {
            "port": self.port,
            "unix_socket_directories": self.folder,
            "listen_addresses": "127.0.0.1",
            "max_connections": 200,
            "shared_buffers": "32MB",
            "fsync": "on" if fsync else "off",
        }
        options = [f"-c{name}={value}" for name, value in settings.items()]
        command = [self._programs / "postgres", "-D", self.folder / "data", *options]
        with (self.folder / "log").open("ab") as log:
            self.process = subprocess.Popen(
                [*self._as_user(), *command], stdout=log, stderr=log, start_new_session=True
            )
        ready = [
            self._programs / "pg_isready",
            "-q",
            "-U",
            _USER,
            "-h",
            "127.0.0.1",
            "-p",
            str(self.port),
        ]
        end = time.monotonic() + 60  # after a kill, the server first recovers what it had stored
        while time.monotonic() < end:
            if subprocess.run(ready, check=False).returncode == 0:
                return
            assert self.process.poll() is None, (self.folder / "log").read_text()[-3000:]
            time.sleep(0.05)
        raise AssertionError((self.folder / "log").read_text()[-3000:])

    def kill(self) -> None:
        """Kill all of the server's processes at once, as a power failure would."""
        assert self.process is not None, "it does not run"
        # Each process for a client has a group of its own, and would first finish its transaction.
        os.killpg(self.process.pid, signal.SIGSTOP)
        for each in _descendants(self.process.pid):
            with contextlib.suppress(ProcessLookupError):
                os.kill(each, signal.SIGKILL)
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait(10)
        self.process = None

    def stop(self) -> None:
        """End the server."""
        if self.process is not None:
            self.process.send_signal(signal.SIGINT)
            self.process.wait(20)
            self.process = None

    def remove(self) -> None:
        """End the server and delete its data."""
        if self.process is not None:
            self.kill()
        shutil.rmtree(self.folder, ignore_errors=True)

    def url(self, database: str = "postgres") -> str:
        """The URL of a database."""
        return f"postgresql://{_USER}@127.0.0.1:{self.port}/{database}"

    def new_database(self) -> str:
        """Make an empty database; returns its URL."""
        self._made += 1
        name = f"fleet_{os.getpid()}_{self._made}"
        self.execute(f"CREATE DATABASE {name}")
        return self.url(name)

    def execute(self, statement: str, database: str = "postgres") -> list[tuple[object, ...]]:
        """Run a statement; returns its rows."""
        import psycopg

        with psycopg.connect(self.url(database), autocommit=True) as connection:
            cursor = connection.execute(statement)
            return cursor.fetchall() if cursor.description else []

    def _run(self, program: str, *arguments: object) -> None:
        command = [*self._as_user(), str(self._programs / program), *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, cwd="/tmp")
        assert not done.returncode, done.stderr

    @staticmethod
    def _as_user() -> list[str]:
        # `setpriv` keeps the process, so that a signal reaches PostgreSQL itself.
        if os.geteuid():
            return []
        return ["setpriv", "--reuid=postgres", "--regid=postgres", "--init-groups"]


@contextlib.contextmanager
def _running_cluster(**options):
    """A running PostgreSQL; the test is skipped, or fails if one is required, without programs."""
    if reason := why_missing():
        if os.environ.get("TASKRPC_NEEDS_POSTGRES"):
            pytest.fail(reason)
        pytest.skip(reason)
    cluster = Cluster()
    try:
        cluster.start(**options)
        yield cluster
    finally:
        cluster.remove()


@pytest.fixture(scope="session")
def shared_cluster():
    """A running PostgreSQL for all tests of a session that do not break it."""
    with _running_cluster(fsync=False) as cluster:
        yield cluster


@pytest.fixture
def postgres_url(shared_cluster):
    """The URL of a new database."""
    return shared_cluster.new_database()


@pytest.fixture
def own_cluster():
    """A running PostgreSQL that the test may kill."""
    with _running_cluster() as cluster:
        yield cluster


@pytest.fixture
def pgbouncer(postgres_url, shared_cluster):
    """Returns a function that starts a PgBouncer in a pool mode and returns the URL through it."""
    program = shutil.which("pgbouncer") or shutil.which("pgbouncer", path="/usr/sbin")
    if program is None:
        pytest.skip("PgBouncer is not installed: apt-get install pgbouncer")
    folder = Path(tempfile.mkdtemp(prefix="taskrpc-pgbouncer-"))
    started = []

    def start(mode: str) -> str:
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        settings = folder / f"{mode}.ini"
        settings.write_text(
            f"[databases]\n* = host=127.0.0.1 port={shared_cluster.port} user={_USER}\n"
            f"[pgbouncer]\nlisten_addr = 127.0.0.1\nlisten_port = {port}\nauth_type = any\n"
            f"unix_socket_dir =\npool_mode = {mode}\ndefault_pool_size = 20\n"
        )
        if os.geteuid() == 0:
            shutil.chown(folder, "postgres")
            shutil.chown(settings, "postgres")
        with (folder / "log").open("ab") as log:
            command = [*Cluster._as_user(), program, "-q", settings]
            started.append(subprocess.Popen(command, stdout=log, stderr=log))
        for _ in range(500):
            with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 1):
                break
            assert started[-1].poll() is None, (folder / "log").read_text()
            time.sleep(0.01)
        return postgres_url.replace(f":{shared_cluster.port}/", f":{port}/")

    yield start
    for process in started:
        process.kill()
        process.wait(10)
    shutil.rmtree(folder, ignore_errors=True)
