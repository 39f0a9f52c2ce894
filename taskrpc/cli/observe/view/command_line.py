"""`taskrpc view`: opens the live page of the task server, a recording or the labs in the browser.

On a laptop that has joined a lab, it prints the links of the lab's page: a server that it started
here would answer the calls that are meant for the lab.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import subprocess
import sys
import time
import webbrowser
from collections.abc import Iterator, Sequence
from types import FrameType

from taskrpc.cli.shared.command import Exit, NotFound, UsageError, hinted
from taskrpc.cli.shared.page_link import PageLink, noted_links
from taskrpc.cli.shared.remote import called_lab
from taskrpc.errors import TaskRpcError
from taskrpc.spi import Registry, domain_id, suggestions

START_TIMEOUT = 20.0
"""Seconds that a new server gets to serve its page."""

_SERVICE = "/robot_task"
_START = (
    "import sys; sys.argv[0] = 'taskrpc-server'; from taskrpc.__main__ import server;"
    " sys.exit(server())"
)
"""A program that runs taskrpc-server, also where the scripts are not installed."""
_POLL = 0.05  # seconds between two looks for the page
_END_TIMEOUT = 5.0  # seconds that the server gets to end
_LONGEST_WAIT = 1.0
"""Seconds after which Ctrl-C has an effect at the latest. Python only records a signal that arrives
just before a blocking call, and the call does not end."""


def configure(parser: argparse.ArgumentParser) -> None:
    """Give a parser the arguments of `view`."""
    parser.epilog = (
        "If no task server runs, `taskrpc view` without FILE starts taskrpc-server --web, and ends"
        " it at Ctrl-C; with a joined lab, it prints the links of the lab's page instead. Keep the"
        " link for control secret: each person who has it can control the robot."
    )
    add = parser.add_argument
    what = "A recording to show: a .mcap file, or the folder of a bag of rosbag2"
    add("file", metavar="FILE", nargs="?", help=what)
    add("--no-browser", action="store_true", help="Print the links instead of opening a browser")
    what = "Open the page for a projector: large letters, and no buttons"
    add("--projector", action="store_true", help=what)
    what = "The robot whose page to open, such as /robot2/robot_task. Default: the first one"
    add("--service", metavar="NAME", help=what)
    group = parser.add_argument_group("labs")
    add = group.add_argument
    what = "Open the page on which the first labs run in the browser, without a task server"
    add("--lab", metavar="N", nargs="?", type=int, const=1, help=what)
    add("--variant", metavar="ID", help="The variant of the labs, such as the student's name")
    what = "The port of this page; browsers keep your programs for each port. Default: 8737"
    add("--port", type=int, help=what)
    what = "Take Pyodide from this folder, such as browser-lab of a classroom bundle"
    add("--pyodide", metavar="FOLDER", help=what)
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> int:
    if options.lab is not None:
        from taskrpc.cli.course.lab.browser_page import view as view_labs  # reads many files

        return view_labs(options)
    for name in ("variant", "port", "pyodide"):
        if getattr(options, name) is not None:
            raise UsageError(f"--{name} belongs to --lab: taskrpc view --lab --{name} …")
    if options.file is not None:
        from taskrpc.cli.observe.view.recording import view  # needs two extras

        return view(options)
    if links := noted_links():
        _show(_chosen(links, options.service), options)
        return Exit.DONE
    if options.service is not None:
        raise NotFound(f"no server of this machine has a live page of {options.service}")
    _refuse_server_without_page()
    if (lab := called_lab()) is not None:
        from taskrpc.cli.course.classroom.lab_page import view_lab  # few users have joined a lab

        return view_lab(lab)
    return _run_server(options)


def _chosen(links: Sequence[PageLink], service: str | None) -> PageLink:
    """Return the newest page, that of the first robot if one server has several.

    With `service`, return the page of this service. Raises NotFound.
    """
    of_one = [each for each in links if each.pid == links[0].pid]
    wanted = service or min((each.service for each in of_one), key=len)
    for link in of_one if service is None else links:
        if link.service == wanted:
            return link
    known = ", ".join(sorted({each.service for each in links}))
    raise NotFound(f"no live page shows {service}; there are pages of: {known}")


def _refuse_server_without_page() -> None:
    """Raise NotFound if a task server runs that has no page: a second one could not start."""
    for entry in suggestions.others(Registry(domain_id()).entries()):
        if entry.offers(_SERVICE):
            program = f"{entry.script} (pid {entry.pid})"
            raise hinted(
                NotFound(f"{program} offers {_SERVICE}, but has no live page"),
                f"end it with `taskrpc stop {entry.pid}`, and start it with --web 127.0.0.1:0",
            )


def _run_server(options: argparse.Namespace) -> int:
    """Start a server with a page, show the page, and end the server at Ctrl-C or SIGTERM."""
    command = [sys.executable, "-c", _START, "--web", "127.0.0.1:0"]
    with _exit_at_signals(), subprocess.Popen(command) as server:
        try:
            _show(_link_of(server), options)
            print("Ctrl-C ends the server", file=sys.stderr, flush=True)
            return _status_of(server)
        except KeyboardInterrupt:
            return Exit.INTERRUPTED
        finally:
            _end(server)


@contextlib.contextmanager
def _exit_at_signals() -> Iterator[None]:
    """Raise SystemExit at SIGTERM or SIGHUP: their default action would leave the server alone."""

    def leave(number: int, _: FrameType | None) -> None:
        signal.signal(number, signal.SIG_IGN)  # a second signal must not stop the cleanup
        raise SystemExit(128 + number)

    names = ("SIGTERM", "SIGHUP")  # Windows has no SIGHUP
    found = [getattr(signal, name) for name in names if hasattr(signal, name)]
    # A signal that the parent ignores, as nohup does, stays ignored.
    caught = [each for each in found if signal.getsignal(each) is signal.SIG_DFL]
    for each in caught:
        signal.signal(each, leave)
    try:
        yield
    finally:
        for each in caught:
            signal.signal(each, signal.SIG_DFL)


def _link_of(server: subprocess.Popen[bytes]) -> PageLink:
    """Wait for the page of a new server. Raises TaskRpcError."""
    deadline = time.monotonic() + START_TIMEOUT
    while time.monotonic() < deadline and server.poll() is None:
        for link in noted_links():
            if link.pid == server.pid:
                return link
        time.sleep(_POLL)
    if server.poll() is not None:
        raise TaskRpcError("taskrpc-server could not start; the lines above say why")
    raise TaskRpcError(f"taskrpc-server did not serve its page within {START_TIMEOUT:g} s")


def _status_of(server: subprocess.Popen[bytes]) -> int:
    """Wait for the end of a server; returns its exit status."""
    while True:
        with contextlib.suppress(subprocess.TimeoutExpired):
            return server.wait(_LONGEST_WAIT)


def _end(server: subprocess.Popen[bytes]) -> None:
    if server.poll() is not None:
        return
    try:
        # At Ctrl-C a terminal signals both processes; if only this one got it, pass it on.
        server.wait(0.2)
    except subprocess.TimeoutExpired:
        server.send_signal(signal.SIGTERM)
        try:
            server.wait(_END_TIMEOUT)
        except subprocess.TimeoutExpired:
            server.kill()


def _show(link: PageLink, options: argparse.Namespace) -> None:
    """Open the page in the browser, or print its links if no browser can be opened."""
    if not options.no_browser and link.is_local:
        chosen = link.projector_link if options.projector else link.control_link
        if webbrowser.open(chosen):
            print(f"the live page is at {link.url}/", file=sys.stderr, flush=True)
            return
        print("found no browser; open one of these links yourself:", file=sys.stderr)
    elif not options.no_browser:
        # All users of this machine can see a browser's command line. On this machine, the guard
        # refuses the tokens of links from other users; from other machines it accepts them.
        why = "other machines can reach this page, so no browser was started"
        print(f"{why}; open one of these links yourself:", file=sys.stderr)
    print(f"control:   {link.control_link}")
    print(f"read-only: {link.view_link}")
    print(f"projector: {link.projector_link}", flush=True)
