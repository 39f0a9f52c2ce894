"""The registry shows no dead process and no incomplete entry, and nothing to other users."""

import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
import time
import zlib
from pathlib import Path

import pytest

import taskrpc
from taskrpc.core.system import file_locks, private_files
from taskrpc.core.transport.discovery import registry as registry_module
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.discovery.journal import line_of
from taskrpc.core.transport.discovery.registry import Registry
from taskrpc.core.wire.messages import ServiceEndpoint

ADD = ServiceEndpoint("/add", "example_interfaces/srv/AddTwoInts", "RIHS01_1", "/adder")


def entry(**fields):
    defaults = {"pid": os.getpid(), "script": "adder.py", "folder": "/home/me", "since": 1.0}
    return RegistryEntry(**{**defaults, **fields})


def publish(registry, wanted, **options):
    """Return the first entry of a process."""
    registry.publish(TrackedEntry(wanted), EntryChange(), **options)


@pytest.fixture
def registry():
    registry = Registry(0)
    yield registry
    registry.close()


@pytest.fixture
def other():
    other = Registry(0)
    yield other
    other.close()


def files(registry):
    return sorted(registry._files())


def test_a_published_entry_is_visible_to_other_processes(registry, other):
    mine = entry(services=(ADD,), address="127.0.0.1:7", token="ab")
    tracked = TrackedEntry(mine)
    registry.publish(tracked, EntryChange())
    assert other.entries() == [mine]
    registry.publish(tracked, EntryChange(node="/a"))
    registry.publish(tracked, EntryChange(service=ADD, gone=True))
    changed = entry(nodes=("/a",), address="127.0.0.1:7", token="ab")
    assert other.entries() == registry.entries() == [changed]


def test_the_oldest_process_comes_first(registry, other):
    publish(registry, entry(since=2.0))
    publish(other, entry(since=1.0))
    assert [each.since for each in registry.entries()] == [1.0, 2.0]


def test_a_closed_registry_leaves_no_file(registry, other):
    publish(registry, entry())
    registry.close()
    assert other.entries() == []
    assert files(other) == []


DIES = """
import os, sys, time
from taskrpc.core.transport.discovery.entries import EntryChange, RegistryEntry, TrackedEntry
from taskrpc.core.transport.discovery.registry import Registry
registry = Registry(0)
dead = RegistryEntry(pid=os.getpid(), script="dead.py", folder="/", since=0.0)
registry.publish(TrackedEntry(dead), EntryChange())
print("there", flush=True)
time.sleep(60)
"""


@pytest.mark.real_time
def test_a_killed_process_is_never_believed_and_its_file_is_removed(registry):
    with subprocess.Popen([sys.executable, "-c", DIES], stdout=subprocess.PIPE, text=True) as dying:
        assert dying.stdout.readline() == "there\n"
        assert [each.script for each in registry.entries()] == ["dead.py"]
        dying.kill()
        dying.wait(10)
    assert registry.entries() == []
    assert files(registry) == []


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork on Windows")
@pytest.mark.real_time
def test_a_forked_child_does_not_keep_its_dead_parents_entry_alive(registry):
    program = DIES.replace("time.sleep(60)", "os.fork(); time.sleep(60)")
    with subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, start_new_session=True
    ) as parent:
        parent.stdout.readline()
        time.sleep(0.1)
        parent.kill()
        parent.wait(10)
        assert registry.entries() == []
        os.killpg(parent.pid, signal.SIGKILL)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork on Windows")
@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_child_that_closes_leaves_its_parents_entry(registry, other):
    publish(registry, entry())
    child = os.fork()
    if not child:
        registry.close()
        os._exit(0)
    os.waitpid(child, 0)
    assert other.entries() == [entry()]


def test_concurrent_readers_agree_on_living_and_dead_processes(registry, other):
    publish(registry, entry(services=(ADD,)))
    left_over = registry._folder.path / "1-dead.json"
    problems = []

    def look():
        looking = Registry(0)
        for _ in range(60):
            left_over.write_bytes(line_of(1, entry(script="dead.py")))
            if [each.script for each in looking.entries()] != ["adder.py"]:
                problems.append(looking.entries())

    threads = [threading.Thread(target=look) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert problems == []
    other.entries()
    assert not left_over.exists()


def test_a_reader_never_sees_half_an_entry(registry):
    """Readers see no torn content and miss no living process while its entry grows and shrinks."""
    stop = threading.Event()
    names = [f"/node{n}_{'x' * 50}" for n in range(300)]
    tracked = TrackedEntry(entry())
    registry.publish(tracked, EntryChange())

    def write():
        while not stop.is_set():
            for gone in (False, True):
                for name in names:
                    registry.publish(tracked, EntryChange(node=name, gone=gone))

    writer = threading.Thread(target=write)
    writer.start()
    reader = Registry(0)
    try:
        for _ in range(300):
            (seen,) = reader.entries()
            assert list(seen.nodes) in (names[: len(seen.nodes)], names[-len(seen.nodes) :])
    finally:
        stop.set()
        writer.join()
    assert reader.entries() == registry.entries()


@pytest.mark.parametrize(
    "contents",
    [
        b"",
        b"\n",
        b"garbage",
        b"00000000 1 {}\n",
        b"%08x 1 {}\n" % zlib.crc32(b"1 {}"),
        b"%08x one {}\n" % zlib.crc32(b"one {}"),
        b"%08x nonsense\n" % zlib.crc32(b"nonsense"),
        b"\xff" * 100,
        line_of(1, entry())[:-1],
        line_of(1, entry()).replace(b"adder.py", b"other.py"),
        line_of(1, EntryChange(node="/a")),
    ],
)
def test_an_unreadable_entry_of_a_living_process_is_passed_over(registry, contents):
    path = registry._folder.path / "2-odd.json"
    descriptor = private_files.open_private(path)
    file_locks.lock(descriptor)
    os.write(descriptor, contents)
    publish(registry, entry())
    assert registry.entries() == [entry()]
    assert path.exists()
    os.close(descriptor)


def test_two_hundred_processes_are_read():
    registries = [Registry(0) for _ in range(200)]
    for n, each in enumerate(registries):
        publish(each, entry(since=float(n), services=(ADD,)))
    assert len(registries[0].entries()) == 200
    for each in registries:
        each.close()
    assert Registry(0).entries() == []


def test_every_change_changes_the_signature(registry, other, monkeypatch):
    """Also if the system's clock stands still, and for many new entries of the same length."""
    monkeypatch.setattr(time, "time_ns", lambda: 10**18)
    seen = {other.signature()}
    tracked = TrackedEntry(entry())
    for _ in range(250):
        for gone in (False, True):
            registry.publish(tracked, EntryChange(node="/n", gone=gone))
            seen.add(other.signature())
    registry.close()
    seen.add(other.signature())
    assert len(seen) == 502


def test_readers_see_each_of_many_changes_at_once(registry, other):
    tracked = TrackedEntry(entry())
    for n in range(300):
        registry.publish(tracked, EntryChange(node="/n", client=ADD, gone=bool(n % 2)))
        assert other.entries() == [tracked.entry()]


def test_only_one_of_two_concurrent_claims_succeeds(registry):
    """Each claim is an entry's first service or one of many; two processes claim alternately."""
    wins = []

    def claim(own):
        tracked = TrackedEntry(entry())
        for n in range(60):
            service = ServiceEndpoint(f"/s{n}", "a/srv/B", "RIHS01_1", "/a")
            try:
                own.publish(tracked, EntryChange(service=service), claim=service.name)
            except taskrpc.NameInUse:
                continue
            wins.append(n)

    registries = [Registry(0) for _ in range(3)]
    threads = [threading.Thread(target=claim, args=(own,)) for own in registries]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(wins) == list(range(60))
    offered = [service.name for each in registry.entries() for service in each.services]
    assert sorted(offered) == sorted({f"/s{n}" for n in range(60)})
    for own in registries:
        own.close()


def test_readers_of_removed_files_are_forgotten(registry):
    for n in range(20):
        passing = Registry(0)
        publish(passing, entry(since=float(n)))
        registry.entries()
        passing.close()
    registry.entries()
    assert registry._readers == {}


def test_the_bytes_written_for_a_service_do_not_grow_with_the_number_of_services(
    registry, monkeypatch
):
    written = []
    write = os.write
    monkeypatch.setattr(os, "write", lambda fd, data: written.append(len(data)) or write(fd, data))
    tracked = TrackedEntry(entry())

    def spent(count):
        written.clear()
        for _ in range(count):
            name = f"/s{len(tracked.services)}"
            registry.publish(
                tracked, EntryChange(service=ServiceEndpoint(name, "a/srv/B", "R", "/a"))
            )
        return sum(written) / count

    first = spent(500)
    assert spent(4000) < 2 * first


def test_each_server_of_a_name_is_kept_until_it_is_removed(registry, other):
    """Nodes of one program may offer the same name."""
    first, second = (ServiceEndpoint("/s", "a/srv/B", "R", node) for node in ("/a", "/b"))
    tracked = TrackedEntry(entry())
    for server in (first, second, second):
        registry.publish(tracked, EntryChange(service=server))
    (seen,) = other.entries()
    assert sorted(each.node for each in seen.services) == ["/a", "/b", "/b"]
    assert sorted(each.node for each in TrackedEntry(seen).entry().services) == ["/a", "/b", "/b"]
    for server in (second, first):
        registry.publish(tracked, EntryChange(service=server, gone=True))
        assert tracked.offers("/s")
    registry.publish(tracked, EntryChange(service=second, gone=True))
    assert not tracked.offers("/s")
    assert other.entries()[0].services == ()


def test_domains_do_not_see_each_other(registry):
    publish(registry, entry())
    assert Registry(1).entries() == []


def test_a_second_offer_of_a_name_is_refused_with_all_that_helps(registry, other):
    publish(registry, entry(pid=4711, services=(ADD,), since=0.0))
    with pytest.raises(taskrpc.NameInUse) as caught:
        publish(other, entry(), claim="/add")
    began = time.strftime("%H:%M:%S", time.localtime(0))
    assert str(caught.value) == (
        f"/add is already offered by adder.py (pid 4711, in /home/me, since {began}); end it with"
        " `taskrpc stop 4711`, or join it with --join (join=True)"
    )
    publish(other, entry(), claim="/subtract")
    publish(registry, entry(services=(ADD,)), claim="/add")  # the own entry does not conflict


def test_a_dead_process_does_not_hold_a_name(registry):
    (registry._folder.path / "1-dead.json").write_bytes(line_of(1, entry(services=(ADD,))))
    publish(registry, entry(services=(ADD,)), claim="/add")


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
def test_folder_and_entry_are_the_users_alone(registry):
    publish(registry, entry())
    for path in (registry._folder.path, registry._folder.path.parent):
        assert stat.S_IMODE(path.stat().st_mode) == 0o700
    assert stat.S_IMODE((registry._folder.path / registry._name).stat().st_mode) == 0o600


@pytest.mark.skipif(os.name != "posix", reason="modes are POSIX's")
def test_a_folder_open_to_others_is_closed_to_them(registry):
    registry._folder.path.chmod(0o755)
    Registry(0)
    assert stat.S_IMODE(registry._folder.path.stat().st_mode) == 0o700


@pytest.mark.skipif(os.name != "posix", reason="links and owners are POSIX's")
def test_a_folder_that_is_a_link_or_another_users_is_refused(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "taskrpc").symlink_to(tmp_path / "elsewhere")
    with pytest.raises(taskrpc.TaskRpcError, match="found a link or a file"):
        Registry(0)
    (tmp_path / "taskrpc").unlink()
    (tmp_path / "taskrpc").mkdir()
    monkeypatch.setattr(os, "getuid", lambda: 4242)
    with pytest.raises(taskrpc.TaskRpcError, match="belongs to another user"):
        Registry(0)


def test_a_link_in_the_folder_is_not_followed(registry, tmp_path, symlink):
    (tmp_path / "forged").write_bytes(line_of(1, entry(script="forged")))
    link = registry._folder.path / "9-link.json"
    symlink(link, tmp_path / "forged")
    assert registry.entries() == []
    assert Path(tmp_path / "forged").exists()


def test_every_change_changes_the_signature_also_where_the_clock_stands_ahead(
    registry, other, monkeypatch
):
    monkeypatch.setattr(time, "time_ns", lambda: 3 * 10**18)
    tracked, seen = TrackedEntry(entry()), []
    for gone in (False, True, False):
        registry.publish(tracked, EntryChange(node="/n", gone=gone))
        seen.append(other.signature())
    assert len(set(seen)) == 3


def leave_behind(registry, name="1-dead.json"):
    """Create the file of a dead process."""
    left = registry._folder.path / name
    left.write_bytes(line_of(1, entry(script="dead.py", services=(ADD,))))
    return left


def test_removing_a_dead_entry_is_a_change(registry, other):
    publish(other, entry())
    leave_behind(registry)
    before = registry.signature()
    assert len(registry.entries()) == 1
    assert registry.signature() != before
    assert len(files(registry)) == 1


def test_dead_entries_that_cannot_be_removed_are_passed_over(registry, other, monkeypatch):
    publish(other, entry())
    leave_behind(registry)

    def refused(path, **options):
        raise PermissionError(13, "not yours")

    monkeypatch.setattr(os, "unlink", refused)
    assert [each.script for each in registry.entries()] == ["adder.py"]
    other.close()  # its own file cannot be removed either
    assert registry.entries() == []


def test_name_of_a_living_server_is_refused_beside_many_dead_ones(registry, other):
    publish(other, entry(services=(ADD,)))
    for number in range(20):
        leave_behind(registry, f"{number}-dead.json")
    with pytest.raises(taskrpc.errors.NameInUse):
        publish(registry, entry(), claim="/add")


def test_lock_without_a_settable_time_still_works(registry, other, monkeypatch):
    utime = os.utime

    def refused(path, **options):
        if Path(path).name == "lock":
            raise PermissionError(1, "not permitted")
        utime(path, **options)

    monkeypatch.setattr(os, "utime", refused)
    publish(registry, entry())
    assert other.entries() == [entry()]


def test_abandoned_entry_is_dead(registry, other):
    publish(registry, entry())
    registry.abandon()
    assert other.entries() == []
    assert files(other) == []
    registry.abandon()


@pytest.mark.parametrize(
    ("session", "name"),
    [("/home/ana/lab1.ipynb", "notebook lab1.ipynb"), (None, "a notebook")],
)
def test_kernel_of_a_notebook_is_named_after_the_notebook(session, name, monkeypatch):
    monkeypatch.setattr(sys, "argv", ["/opt/python/site-packages/ipykernel_launcher.py"])
    monkeypatch.delenv("JPY_SESSION_NAME", raising=False)
    if session:
        monkeypatch.setenv("JPY_SESSION_NAME", session)
    assert registry_module.this_process().script == name


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no open files")
def test_a_process_whose_file_was_removed_can_still_publish(registry):
    publish(registry, entry())
    for path in registry._folder.path.iterdir():
        path.unlink()
    publish(registry, entry())
    registry.close()
    assert [path.name for path in registry._folder.path.iterdir()] == ["lock"]


@pytest.mark.skipif(sys.platform == "win32", reason="Windows removes no open files")
def test_entry_that_is_written_again_is_not_taken_for_the_removed_one(registry, other):
    tracked, subtract = TrackedEntry(entry()), ServiceEndpoint("/sub", "a/srv/B", "RIHS01_1", "/a")
    registry.publish(tracked, EntryChange(service=ADD))
    assert [each.services for each in other.entries()] == [(ADD,)]
    registry.publish(tracked, EntryChange(service=ADD, gone=True))
    shutil.rmtree(registry._folder.path)
    registry.publish(tracked, EntryChange(service=subtract))  # begins as the removed file did
    assert [each.services for each in other.entries()] == [(subtract,)]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork here")
def test_forked_child_that_publishes_has_a_file_of_its_own(registry, other):
    publish(registry, entry())
    ours, parent = files(registry), os.getpid()
    if (child := os.fork()) == 0:
        try:
            publish(registry, entry())
        finally:
            os._exit(0 if len(files(registry)) == 2 and os.getpid() != parent else 1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0
    other.entries()  # removes the file of the child, which is dead
    assert files(registry) == ours
