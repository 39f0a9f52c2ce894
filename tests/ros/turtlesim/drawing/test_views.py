"""Where turtlesim draws."""

import io
import re
import sys

import pytest

from taskrpc.errors import TaskRpcError
from taskrpc.ros.turtlesim.drawing import views
from taskrpc.ros.turtlesim.world import World

if sys.platform in ("win32", "darwin"):
    pytest.skip("there, a window needs no DISPLAY", allow_module_level=True)

BLUE = (69, 86, 255)


@pytest.fixture(autouse=True)
def no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)


@pytest.fixture
def no_web(monkeypatch):
    monkeypatch.setitem(sys.modules, "aiohttp", None)
    for name in ("taskrpc.ros.turtlesim.drawing.web_view", "taskrpc.observe.web.server"):
        monkeypatch.delitem(sys.modules, name, raising=False)


class A_terminal(io.StringIO):
    def isatty(self):
        return True


def test_without_any_view_it_says_how_to_see_a_turtle(no_web, capsys):
    with views.opened("auto") as view:
        assert view.draw(World(), BLUE)
        assert list(view.pressed_keys()) == []
    hint = capsys.readouterr().err
    assert "pip install aiohttp" in hint
    assert "taskrpc topic echo /turtle1/pose" in hint


@pytest.mark.real_time
def test_without_display_it_prints_the_link_of_a_web_page(capsys):
    pytest.importorskip("aiohttp")
    with views.opened("auto", 0) as view:
        assert view.draw(World(), BLUE)
    assert re.search(
        r"a web page of this computer: http://127\.0\.0\.1:\d+/#control=", capsys.readouterr().err
    )


def test_without_display_and_aiohttp_it_draws_in_the_terminal(no_web, monkeypatch):
    output = A_terminal()
    monkeypatch.setattr(sys, "stdout", output)
    with views.opened("auto") as view:
        assert view.draw(World(), BLUE)
    assert "\u2580" in output.getvalue()


def test_none_draws_nowhere_and_says_nothing(capsys):
    with views.opened("none") as view:
        assert view.draw(World(), BLUE)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("name", "problem"),
    [
        ("window", "cannot open a window: expected a display, but the variable DISPLAY is not set"),
        ("page", "--view page needs aiohttp: pip install aiohttp"),
        ("terminal", "cannot draw: expected a terminal as the output"),
    ],
)
def test_a_named_view_that_does_not_work_is_an_error_with_its_reason(no_web, name, problem):
    with pytest.raises(TaskRpcError, match=problem), views.opened(name):
        pass


def test_a_paced_view_draws_at_most_thirty_times_a_second_and_reports_its_end(monkeypatch):
    class Shown:
        times = 0

        def show(self, world, background, title):
            self.times += 1
            return self.times < 3

        def close(self):
            pass

    now = 100.0
    monkeypatch.setattr(views.time, "monotonic", lambda: now)
    shown = Shown()
    view = views.PacedView(shown)
    results = []
    for _ in range(5):
        results.append(view.draw(World(), BLUE))
        now += 0.02
    assert (results, shown.times) == ([True, True, True, True, False], 3)
