"""Starts turtlesim's programs in a domain of their own."""

import contextlib
import subprocess
import sys

from taskrpc.cli.main import main
from tests.ros.packages.rclpy.programs.running import Program, domain_in, programs_in


class Turtlesim:
    """Starts the executables of turtlesim, programs in files, and commands."""

    def __init__(self, folder, capsys, script):
        self._folder, self._capsys = folder, capsys
        self._started = []
        self.script = script
        """Starts a program from its source."""

    def run(self, executable, *arguments, stdin=None):
        """Start an executable of turtlesim."""
        return self.start("run", "turtlesim", executable, *arguments, stdin=stdin)

    def start(self, *line, stdin=None):
        """Start a command of taskrpc in a process."""
        process = subprocess.Popen(
            [sys.executable, "-u", "-m", "taskrpc", *line],
            cwd=self._folder,
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        self._started.append((Program(process), process))
        return self._started[-1]

    def node(self, *arguments):
        """Start the node without a view, and wait for its first turtle."""
        program, _ = self.run("turtlesim_node", "--view", "none", *arguments)
        program.wait_for("Spawning turtle")
        return program

    def command(self, *line):
        """Run a command of taskrpc in this process; return what it prints to stdout."""
        self._capsys.readouterr()
        main(list(line))
        return self._capsys.readouterr().out

    def end(self):
        """Kill what still runs."""
        for program, process in self._started:
            if process.stdin is not None:
                process.stdin.close()
            program.kill()


@contextlib.contextmanager
def turtlesim_in(folder, monkeypatch, capsys):
    """Programs that run in this folder and see only each other; kills them at the end."""
    for name, value in domain_in(folder).items():
        monkeypatch.setenv(name, value)
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.chdir(folder)
    with programs_in(folder) as script:
        turtlesim = Turtlesim(folder, capsys, script)
        try:
            yield turtlesim
        finally:
            turtlesim.end()
