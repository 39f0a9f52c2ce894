"""The browser reports mistakes: each one that is planted into a page is found."""

from __future__ import annotations

import contextlib
import functools
import http.server
import threading

import pytest

PAGE = """<!doctype html><html lang="en"><head><title>A page</title>
<meta name="viewport" content="width=device-width"><link rel="icon" href="data:,"></head>
<body><main><h1>Hello</h1>{}</main>
<script src="/page.js"></script></body></html>"""
POLICY = "default-src 'none'; script-src 'self'; connect-src 'self'; img-src data:"


class _Handler(http.server.BaseHTTPRequestHandler):
    def __init__(self, texts, *arguments):
        self._texts = texts
        super().__init__(*arguments)

    def do_GET(self):
        kind, text = self._texts.get(self.path, (None, "no such page"))
        self.send_response(404 if kind is None else 200)
        self.send_header("Content-Type", f"{kind or 'text/plain'}; charset=utf-8")
        self.send_header("Content-Security-Policy", POLICY)
        self.end_headers()
        self.wfile.write(text.encode())

    def log_message(self, *_):
        pass


@contextlib.contextmanager
def served(body="", script=""):
    texts = {"/": ("text/html", PAGE.format(body)), "/page.js": ("text/javascript", script)}
    handler = functools.partial(_Handler, texts)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}/"
        finally:
            server.shutdown()
            thread.join()


def test_good_page_has_no_problems(tabs):
    with served() as url:
        tab = tabs.open(url)
        assert tab.text("h1") == "Hello"
        assert tab.violations() == []
        assert tabs.problems() == []


@pytest.mark.parametrize(
    "mistake",
    ["<script>1</script>", "<p style='color: red'>red</p>", "<img alt='' src='/picture.png'>"],
)
def test_breach_of_the_content_security_policy_is_reported(tabs, mistake):
    with served(mistake) as url:
        tabs.open(url)
        assert any(report.startswith("policy: ") for report in tabs.problems())


@pytest.mark.parametrize(
    "mistake",
    [
        "console.error('a mistake')",
        "throw new Error('a mistake')",
        "Promise.reject('a mistake')",
        "fetch('/a mistake')",
    ],
)
def test_error_of_a_script_is_reported(tabs, mistake):
    with served(script=mistake) as url:
        tab = tabs.open(url)
        found = tab.wait(tabs.problems, "a report")
        assert "mistake" in found[0]


def test_expected_error_is_no_problem(tabs):
    with served(script="console.error('the server has ended')") as url:
        tabs.expect("the server has ended")
        tabs.open(url)
        assert tabs.problems() == []


@pytest.mark.parametrize(
    ("mistake", "rule"),
    [
        ("<img src='data:image/gif;base64,R0lGODlhAQABAAAAACw='>", "image-alt"),
        ("<button></button>", "button-name"),
        ("<font color='#cccccc'>pale</font>", "color-contrast"),
    ],
)
def test_barrier_for_readers_is_found(tabs, mistake, rule):
    with served(mistake) as url:
        assert [each.split()[0] for each in tabs.open(url).violations()] == [rule]


def test_text_that_is_still_appearing_is_no_barrier(tabs):
    with served("<p id='slow'>slow</p>") as url:
        tab = tabs.open(url)
        tab.run("document.getElementById('slow').animate([{opacity: 0}, {opacity: 1}], 3_600_000)")
        assert tab.violations() == []


# A picture that gets its text with the next but one frame for which a script waits.
_TEXT_COMES_LATE = """
    const [picture, next] = [document.querySelector("img"), requestAnimationFrame];
    let frames = 0;
    globalThis.requestAnimationFrame = drawn => next(time => {
        if (++frames === 2) picture.alt = "";
        drawn(time);
    });
"""


def test_change_that_comes_with_the_next_frames_is_waited_for(tabs):
    with served("<img src='data:image/gif;base64,R0lGODlhAQABAAAAACw='>") as url:
        tab = tabs.open(url)
        tab.run(_TEXT_COMES_LATE)
        assert tab.violations() == []


def test_media_features_and_sizes_are_set(tabs):
    with served() as url:
        tab = tabs.open(url, size=(390, 844), color_scheme="dark", reduced_motion="reduce")
        assert tab.run("return [innerWidth, innerHeight]") == [390, 844]
        for feature in ("(prefers-color-scheme: dark)", "(prefers-reduced-motion: reduce)"):
            assert tab.run("return matchMedia(arguments[0]).matches", feature)
