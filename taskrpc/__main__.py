"""Entry points of the commands; `python -m taskrpc` is the `taskrpc` command.

Each function handles Ctrl-C before the slow import of the command itself.
"""

from __future__ import annotations

import sys

from srvgen.cli import process


def main() -> int:
    """Run `taskrpc` with the arguments of this process and return its exit code."""
    process.begin()
    from taskrpc.cli.main import main

    return main()


def call() -> int:
    """Run `taskrpc-call` with the arguments of this process and return its exit code."""
    process.begin()
    from taskrpc.cli.call import main

    return main()


def server() -> int:
    """Run `taskrpc-server` with the arguments of this process and return its exit code."""
    process.begin(sigterm_is_success=True)
    from taskrpc.cli.robot.server.command_line import main

    return main()


if __name__ == "__main__":
    sys.exit(main())
