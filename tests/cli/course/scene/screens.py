"""Counts the lines of a scene on a projector."""

from taskrpc.cli.course.scene.screen import Screen
from taskrpc.course.scenes.player import excerpt, program_path

COLUMNS = 80


def rows(scene, moments, *, cure):
    """Return how many lines one program of a scene takes."""
    screen = Screen(COLUMNS)
    program = program_path(scene, cure=cure).read_text(encoding="utf-8")
    return sum(
        map(
            len,
            [
                screen.title(scene, cure=cure, like_ros=False),
                screen.code(excerpt(scene, cure=cure).lines(program)),
                *map(screen.moment, moments),
                screen.explanation(scene, cure=cure, like_ros=False),
            ],
        )
    )
