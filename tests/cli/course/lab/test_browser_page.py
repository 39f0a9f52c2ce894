"""`taskrpc view --lab` serves the page of the labs until Ctrl-C, and opens it."""

import webbrowser

import pytest

from taskrpc import TaskRpcError
from taskrpc.cli.course.lab import browser_page
from taskrpc.cli.main import main
from taskrpc.course.browser_lab import server


@pytest.fixture(autouse=True)
def no_page(monkeypatch):
    def interrupted(_):
        raise KeyboardInterrupt

    monkeypatch.setattr(browser_page, "runtime", lambda folder, report: {})
    monkeypatch.setattr(browser_page, "site_files", lambda parts, variant: {"index.html": b""})
    monkeypatch.setattr(browser_page.signal, "signal", lambda *_: None)
    monkeypatch.setattr(server.LabServer, "serve_forever", interrupted)


def test_the_page_opens_in_the_browser(monkeypatch, capsys):
    opened = []
    monkeypatch.setattr(webbrowser, "open", lambda url: opened.append(url) or True)
    assert main(["view", "--lab", "--port", "0"]) == 130
    assert opened[0].startswith("http://127.0.0.1:")
    assert opened[0] in capsys.readouterr().err


def test_the_link_is_printed_without_a_browser(capsys):
    assert main(["view", "--lab", "--port", "0", "--no-browser"]) == 130
    assert capsys.readouterr().out.startswith("http://127.0.0.1:")


def test_a_download_is_named_with_its_size(monkeypatch, capsys):
    def runtime(folder, report):
        report("pyodide.tgz (6.5 MB)")
        return {}

    monkeypatch.setattr(browser_page, "runtime", runtime)
    main(["view", "--lab", "--port", "0", "--no-browser"])
    assert capsys.readouterr().err.startswith("downloading pyodide.tgz (6.5 MB)\n")


def test_a_missing_download_is_one_line(monkeypatch, capsys):
    def runtime(folder, report):
        raise TaskRpcError("it cannot be downloaded")

    monkeypatch.setattr(browser_page, "runtime", runtime)
    assert main(["view", "--lab", "--port", "0"]) == 1
    assert capsys.readouterr().err.strip().endswith("it cannot be downloaded")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [(["--lab", "9"], "--lab: expected one of 1"), (["--port", "1"], "--port belongs to --lab")],
)
def test_arguments_that_do_not_fit_are_named(capsys, arguments, words):
    assert main(["view", *arguments]) == 2
    assert words in capsys.readouterr().err
