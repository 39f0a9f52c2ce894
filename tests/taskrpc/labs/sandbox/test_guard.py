"""What the audit hook refuses, without the kernel's help."""

import subprocess
import sys
import textwrap

import pytest

pytestmark = [pytest.mark.labs, pytest.mark.real_time]

START = """
import os, signal, socket, sqlite3, subprocess, sys, tempfile
from pathlib import Path
import taskrpc, srvgen
from taskrpc.labs.sandbox import guard
own, other = map(Path, sys.argv[1:])
os.chdir(own)
guard.install(guard.readable(), [own])

def refusal(action):
    try:
        action()
    except (PermissionError, ImportError) as error:
        return str(error)
    return "done"
"""


def run(code, tmp_path):
    own, other = tmp_path / "own", tmp_path / "other"
    for each in (own, other):
        each.mkdir()
        (each / "file").write_text("text")
    program = START + textwrap.dedent(code)
    command = [sys.executable, "-c", program, str(own), str(other)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize(
    ("action", "words"),
    [
        ("subprocess.run(['true'])", "may not start other programs"),
        ("os.system('true')", "may not start other programs"),
        ("os.kill(1, 9)", "may not end other programs"),
        ("__import__('ctypes')", "may not use ctypes"),
        ("open(other / 'file')", "may not read"),
        ("open(other / 'new', 'w')", "may not write"),
        ("os.open(other / 'new', os.O_CREAT | os.O_WRONLY)", "may not write"),
        ("os.open(os.fsencode(other / 'file'), os.O_RDONLY)", "may not read"),
        ("os.listdir(other)", "may not read"),
        ("os.listdir('..')", "may not read"),
        ("os.remove(other / 'file')", "may not change"),
        ("os.rename('file', other / 'file')", "may not change"),
        ("os.rename(other / 'file', 'other')", "may not change"),
        ("(other / 'new').mkdir()", "may not change"),
        ("sqlite3.connect(str(other / 'x.db'))", "may not read"),
        ("os.remove(taskrpc.__file__)", "may not change"),
        ("open(taskrpc.__file__, 'a')", "may not write"),
        ("socket.getaddrinfo('example.com', 80)", "has no network"),
        ("socket.socket().connect(('192.0.2.1', 80))", "has no network"),
        ("socket.getaddrinfo('127.0.0.1.example.com', 80)", "has no network"),
        ("socket.socket(type=2).sendto(b'x', ('192.0.2.1', 80))", "has no network"),
    ],
)
def test_action_is_refused_with_its_reason(action, words, tmp_path):
    assert words in run(f"print(refusal(lambda: {action}))", tmp_path)


def test_a_link_out_of_the_folder_is_followed(tmp_path):
    if sys.platform == "win32":
        pytest.skip("links need rights on Windows")
    code = "os.symlink(other / 'file', 'link'); print(refusal(lambda: open('link')))"
    assert "may not read link" in run(code, tmp_path)


def test_what_programs_need_still_works(tmp_path):
    output = run(
        """
        import colorsys, threading
        print(open('file').read())
        Path('new').write_text('x')
        os.rename('new', 'newer')
        open(os.devnull, 'w').write('x')
        sqlite3.connect(':memory:')
        server = socket.socket()
        server.bind(('127.0.0.1', 0))
        server.listen()
        socket.create_connection(server.getsockname()).close()
        threading.Thread(target=print, args=('a thread',)).start()
        """,
        tmp_path,
    )
    assert output.split() == ["text", "a", "thread"]
