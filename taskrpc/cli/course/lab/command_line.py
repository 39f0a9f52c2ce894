"""`taskrpc lab`: starts a lab in the current folder, and checks submissions."""

from __future__ import annotations

from argparse import ArgumentParser, Namespace

from taskrpc.cli.course.lab.check import configure as configure_check
from taskrpc.cli.course.lab.check import here, variant_id
from taskrpc.cli.shared.command import Exit
from taskrpc.cli.shared.parsing import add_command, add_group


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc lab` its arguments."""
    commands = add_group(parser)
    start = add_command(commands, "start", "Write the starter files of a lab into this folder")
    start.add_argument("number", type=int, metavar="N", help="The lab, 1 to 6")
    what = "A name or a number that gives this student a lab of their own, such as an account"
    start.add_argument("--variant", metavar="ID", type=variant_id, default="", help=what)
    start.set_defaults(run=_start)
    check = add_command(commands, "check", "Check the lab in this folder, and explain what fails")
    configure_check(check)


def _start(options: Namespace) -> Exit:
    from taskrpc.course.labs.catalogue import lab
    from taskrpc.course.labs.starter import write_starter
    from taskrpc.course.labs.variants import Variant

    chosen = lab(options.number)
    folder = here()
    paths = write_starter(chosen, Variant(options.variant), folder)
    print(f"Lab {chosen.number}: {chosen.title} (about {chosen.minutes} minutes)")
    print(chosen.goal)
    names = [path.relative_to(folder).as_posix() for path in paths]
    print(f"Your files: {' '.join(names)}")
    print(f"Try next: open {names[0]}, then run `taskrpc lab check`")
    return Exit.DONE
