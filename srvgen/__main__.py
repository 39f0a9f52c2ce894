"""Entry point of the `srvgen` command, also for `python -m srvgen`.

Ctrl-C is handled before the slow import of the command itself.
"""

from __future__ import annotations

import sys

from srvgen.cli import process


def main() -> int:
    """Run `srvgen` with the arguments of this process and return its exit code."""
    process.begin()
    from srvgen.cli.main import main

    return main()


if __name__ == "__main__":
    sys.exit(main())
