"""Tests of the live page in a real browser: `pytest -m browser`; needs the extra `browser`."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.browser.chromium import Tabs, chromium

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
