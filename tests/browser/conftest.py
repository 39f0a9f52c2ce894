"""Tests of the live page in a real browser: `pytest -m browser`; needs the extra `browser`."""

from __future__ import annotations

import contextlib
from pathlib import Path

import pytest

from taskrpc.cli.shared.page_link import noted_links
from tests.browser.chromium import Tabs, chromium
from tests.browser.live_page import LivePage
from tests.browser.task_server import Services, TaskServer

FOLDER = Path(__file__).parent


def pytest_collection_modifyitems(items):
    """Mark all tests of this folder."""
    for item in items:
        if FOLDER in item.path.parents:
            item.add_marker(pytest.mark.browser)
            item.add_marker(pytest.mark.real_time)


@pytest.fixture(scope="session")
def browser():
    """A Chromium for all tests; each test opens tabs of its own."""
    with chromium() as browser:
        yield browser


@pytest.fixture
def tabs(browser):
    """Opens tabs; at its end no page may have reported an error, a warning or a policy breach."""
    with Tabs(browser) as tabs:
        yield tabs
        assert tabs.problems() == []


@pytest.fixture
def start_server(tmp_path):
    """Starts task servers with the options of `TaskServer`, and ends them with the test."""
    started = []

    def start(*options, **settings):
        started.append(TaskServer(tmp_path, *options, **settings))
        return started[-1]

    yield start
    for server in started:
        server.end()


@pytest.fixture(scope="module")
def module_places(tmp_path_factory):
    """The runtime and state folders of the servers that the tests of a module share."""
    places = {}
    for name in ("runtime", "state"):
        folder = tmp_path_factory.mktemp(name)
        folder.chmod(0o700)
        places[f"XDG_{name.upper()}_{'DIR' if name == 'runtime' else 'HOME'}"] = str(folder)
    return places


@pytest.fixture(scope="module")
def start_for_module(module_places, tmp_path_factory):
    """Starts task servers that the tests of a module share: these only look at the tasks.

    `submit` gets the services of the server, to queue tasks before the first test.
    """
    with contextlib.ExitStack() as stack:

        def start(*options, submit=None):
            with pytest.MonkeyPatch.context() as patch:
                for name, folder in module_places.items():
                    patch.setenv(name, folder)
                server = TaskServer(tmp_path_factory.mktemp("server"), *options)
                stack.callback(server.end)
                if submit is not None:
                    with Services() as services:
                        submit(services)
            return server

        yield start


@pytest.fixture
def in_module_places(module_places, monkeypatch):
    """Lets the test's programs find the servers that the tests of a module share."""
    for name, folder in module_places.items():
        monkeypatch.setenv(name, folder)


@pytest.fixture(scope="module")
def busy_server(request, start_for_module):
    """A server with a slow robot, and with the tasks that the test module's `submit` queues."""
    return start_for_module("--speed", "0.01", submit=request.module.submit)


@pytest.fixture
def busy(busy_server, in_module_places):
    """The busy server, for a test that changes nothing."""
    return busy_server


@pytest.fixture
def services():
    """Calls the services of the task server, as the node `ada`."""
    with Services() as services:
        yield services


@pytest.fixture
def open_page(tabs):
    """Opens the live page of a server, with the link for control or with the one that shows."""

    def page(server, *, control=False, query="", **settings):
        link = control_link(server) if control else server.url
        url = link.replace("/#", f"/{query}#") if control else link + query
        return LivePage(tabs.open(url, **settings)).is_live()

    return page


def control_link(server):
    """The link for control of a server, which `taskrpc view` opens."""
    return next(link for link in noted_links() if link.url == server.url.rstrip("/")).control_link
