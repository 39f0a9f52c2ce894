"""`taskrpc scene`: lists the scenes, or shows one: its program, a run of it, why, and the cure."""

from __future__ import annotations

import asyncio
import contextlib
import os
import shutil
import sys
from argparse import ArgumentParser, Namespace
from typing import TYPE_CHECKING

from taskrpc.cli.shared.command import Exit

if TYPE_CHECKING:
    from taskrpc.cli.course.scene.screen import Screen
    from taskrpc.course.scenes.moments import Moment
    from taskrpc.course.scenes.scene import Scene


def configure(parser: ArgumentParser) -> None:
    """Give the parser of `taskrpc scene` its arguments."""
    parser.epilog = (
        "Without NAME, it lists the scenes. The programs really run, in a network of their own:"
        " a robot or a server that already runs is not affected."
    )
    add = parser.add_argument
    add("scene_name", metavar="NAME", nargs="?", help="The scene, such as lost-reply")
    add("--like-ros", action="store_true", help="Behave exactly like ROS 2, even where it hangs")
    add("--cure", action="store_true", help="Show and run only the corrected program")
    what = "Print the whole program and the name of its file, and run nothing"
    add("--code", action="store_true", help=what)
    group = parser.add_argument_group("page")
    add = group.add_argument
    add("--page", action="store_true", help="Show the scenes in the browser, with buttons")
    add("--port", type=int, help="The port of the page; links on slides contain it. Default: 8738")
    add("--no-browser", action="store_true", help="Print the links instead of opening a browser")
    parser.set_defaults(run=_run)


def _run(options: Namespace) -> int:
    from taskrpc.cli.course.scene.screen import Screen
    from taskrpc.cli.shared.command import UsageError
    from taskrpc.course.scenes.catalogue import SCENES, scene

    if options.page:
        return _serve(options)
    for option in ("port", "no_browser"):
        if getattr(options, option):
            raise UsageError(
                f"--{option.replace('_', '-')} belongs to --page: taskrpc scene --page"
            )
    screen = Screen(shutil.get_terminal_size().columns, _is_coloured())
    if options.scene_name is None:
        if options.cure or options.code or options.like_ros:
            raise UsageError("expected the name of a scene; `taskrpc scene` lists them")
        _print(screen.table([(each.name, each.title) for each in SCENES]))
        print(screen.note("\nTry next: taskrpc scene lost-reply"))
        return Exit.DONE
    chosen = scene(options.scene_name)
    if options.code:
        _print_program(chosen, screen, cure=options.cure)
        return Exit.DONE
    if not options.cure:
        _show(chosen, screen, cure=False, like_ros=options.like_ros)
        _wait_for_enter(screen)
    _show(chosen, screen, cure=True, like_ros=options.like_ros)
    return Exit.DONE


def _serve(options: Namespace) -> int:
    """Serve the page of the scenes until Ctrl-C."""
    from taskrpc.cli.course.scene.page import serve  # needs aiohttp
    from taskrpc.cli.shared.command import UsageError
    from taskrpc.course.scenes.catalogue import scene

    if options.cure or options.code or options.like_ros:
        raise UsageError("--page has buttons for --cure and --like-ros: leave these options out")
    name = "" if options.scene_name is None else scene(options.scene_name).name
    return serve(name, port=options.port, browser=not options.no_browser)


def _show(scene: Scene, screen: Screen, *, cure: bool, like_ros: bool) -> None:
    """Show one program of a scene while it runs."""
    from taskrpc.course.scenes.player import excerpt, program_path

    program = program_path(scene, cure=cure).read_text(encoding="utf-8")
    _print(screen.title(scene, cure=cure, like_ros=like_ros))
    _print(screen.code(excerpt(scene, cure=cure).lines(program)))
    asyncio.run(_play(scene, screen, cure=cure, like_ros=like_ros))
    _print(screen.explanation(scene, cure=cure, like_ros=like_ros))


async def _play(scene: Scene, screen: Screen, *, cure: bool, like_ros: bool) -> None:
    """Run a program and print what happens; if nobody reads the output, end the program."""
    from taskrpc.course.scenes.player import play

    news: asyncio.Queue[Moment | None] = asyncio.Queue()
    playing = asyncio.create_task(play(scene, news.put_nowait, cure=cure, like_ros=like_ros))
    playing.add_done_callback(lambda _: news.put_nowait(None))
    try:
        while (moment := await news.get()) is not None:
            _print(screen.moment(moment))
    finally:
        playing.cancel()
        await asyncio.wait([playing])
    await playing


def _print_program(scene: Scene, screen: Screen, *, cure: bool) -> None:
    from taskrpc.course.scenes.player import excerpt, program_path
    from taskrpc.course.scenes.scene import Line

    path = program_path(scene, cure=cure)
    program = path.read_text(encoding="utf-8")
    marked = {each.number for each in excerpt(scene, cure=cure).lines(program) if each.is_marked}
    texts = enumerate(program.splitlines(), start=1)
    print(screen.note(f"{path}"))
    _print(screen.code([Line(number, text, number in marked) for number, text in texts]))


def _wait_for_enter(screen: Screen) -> None:
    """Let the lecturer talk before the cure; if nobody sits at a terminal, go on."""
    if sys.stdin is not None and sys.stdin.isatty() and sys.stdout.isatty():
        print()
        with contextlib.suppress(EOFError):
            input(screen.note("Enter runs the corrected program; Ctrl-C ends "))
    print()


def _is_coloured() -> bool:
    return sys.stdout.isatty() and not os.environ.get("NO_COLOR")


def _print(lines: list[str]) -> None:
    for line in lines:
        print(line, flush=True)
