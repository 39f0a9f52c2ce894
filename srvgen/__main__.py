"""Where the process of the `srvgen` command begins; `python -m srvgen` is the same command.

Ctrl-C is handled before the command itself is imported, which takes longer.
"""

from __future__ import annotations

import sys

from srvgen import process


def main() -> int:
    """Run `srvgen` with the arguments of this process and return its exit code."""
    process.begin()
    from srvgen.cli import main

    return main()


if __name__ == "__main__":
    sys.exit(main())
