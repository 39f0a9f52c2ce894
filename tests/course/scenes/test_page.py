"""The scenes on the live page: the file of their texts, the run as an event, the buttons."""

import asyncio
import json
import re

import pytest

from taskrpc import TaskRpcError
from taskrpc.course.scenes import page as page_module
from taskrpc.course.scenes.catalogue import SCENES
from taskrpc.course.scenes.moments import Moment
from taskrpc.course.scenes.page import OwnTokens, ScenePage, scene_files
from taskrpc.observe.web.pages import JSON
from taskrpc.observe.web.pages import STATIC as WEB_STATIC
from taskrpc.observe.web.streams import Event, LiveStream
from taskrpc.observe.web.tokens import Holder


class Stream(LiveStream):
    """Keeps what is published."""

    def __init__(self):
        super().__init__()
        self.published = []

    def publish(self, events):
        self.published += events

    def runs(self):
        return [json.loads(each.json) for each in self.published if isinstance(each, Event)]


@pytest.fixture
def stream():
    return Stream()


@pytest.fixture
def page(stream):
    return ScenePage(stream)


@pytest.fixture
def release(monkeypatch):
    """Replaces the programs: each one reports one moment, and ends when this is set."""
    ends = asyncio.Event()

    async def play(scene, report, *, cure, like_ros, observer):
        report(Moment(0.123, "program", f"{scene.name} {cure} {like_ros}"))
        await ends.wait()
        if scene.name == "deadlock":
            raise TaskRpcError("the computer is too busy")

    monkeypatch.setattr(page_module, "play", play)
    return ends


async def press(page, body, verb="scene", content_type=JSON):
    answer = await page.answer(verb, content_type, json.dumps(body).encode(), Holder(""))
    return answer.status, json.loads(answer.body)["message"]


def test_file_has_all_scenes_with_their_code():
    found = json.loads(scene_files()["/scenes.json"].body)
    assert [each["name"] for each in found] == [each.name for each in SCENES]
    assert found[0]["code"][0][1] == [
        12,
        "rclpy.spin_until_future_complete(node, future, timeout_sec=1.5)",
        True,
    ]
    assert [each["name"] for each in found if not each["robot"]] == [
        "deadlock",
        *("forgot-return", "two-servers", "eleven-calls", "same-box"),
    ]


def test_module_puts_text_on_the_page_only_as_text():
    files = scene_files()
    assert sorted(files) == ["/scene.css", "/scene.js", "/scenes.json"]
    code = files["/scene.js"].body.decode()
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(", code)
    imported = re.search(r"import \{([^}]*)\} from \"\./dom.js\"", code)[1].split(",")
    exported = (WEB_STATIC / "dom.js").read_text(encoding="utf-8")
    for name in map(str.strip, imported):
        assert code.count(name) > 1, name
        assert re.search(rf"export (const|function) {name}\b", exported), name


async def test_run_is_published_with_its_moments(page, stream, release):
    assert (await press(page, {"name": "late-answer", "cure": True}))[0] == 200
    release.set()
    await asyncio.sleep(1)
    first, second, third = stream.runs()
    assert (first["running"], first["moments"]) == (True, [])
    moment = {"at": 0.12, "actor": "program", "text": "late-answer True False"}
    assert second["moments"] == [moment]
    assert (third["running"], third["problem"], third["number"]) == (False, "", 1)


async def test_only_one_program_runs_at_a_time(page, stream, release):
    assert (await press(page, {"name": "late-answer"}))[0] == 200
    assert await press(page, {"name": "deadlock"}) == (
        409,
        "a program of a scene runs; wait until it has ended",
    )
    release.set()
    await asyncio.sleep(1)
    assert (await press(page, {"name": "deadlock", "like_ros": True}))[0] == 200
    await asyncio.sleep(1)
    assert stream.runs()[-1]["problem"] == "the computer is too busy"
    assert stream.runs()[-1]["number"] == 2


async def test_new_page_gets_the_run(page, stream, release):
    await press(page, {"name": "late-answer"})
    await asyncio.sleep(1)
    stream.published.clear()
    page.begin()
    await asyncio.sleep(1)
    page.end()
    await page.close()
    assert stream.runs()[0]["name"] == "late-answer"
    assert not stream.runs()[-1]["running"]


@pytest.mark.parametrize(
    ("arguments", "status", "words"),
    [
        ({"body": {"name": "deadlok"}}, 400, "there is no scene 'deadlok'"),
        ({"body": {"name": 5}}, 400, "Expected `str`, got `int`"),
        ({"body": {"name": "deadlock"}, "verb": "submit"}, 404, "expected scene, got 'submit'"),
        ({"body": {"name": "deadlock"}, "content_type": "text/plain"}, 400, "Content-Type"),
    ],
)
async def test_wrong_request_is_refused(page, stream, arguments, status, words):
    found = await press(page, **arguments)
    assert found[0] == status
    assert words in found[1]
    assert stream.runs() == []


def test_hello_names_no_map(page):
    text = page.hello(control=True).decode()
    assert text.startswith("event: hello\ndata: {")
    hello = json.loads(text.partition("data: ")[2])
    assert (hello["control"], hello["map"]) == (True, None)
    assert page.task(1) is None


def test_own_user_needs_no_token_and_others_do():
    tokens = OwnTokens()
    assert tokens.holder("") == Holder("")
    assert tokens.holder("", of_links=False) is None
    assert tokens.holder("wrong") is None
    assert tokens.holder(tokens.control) == Holder("")
