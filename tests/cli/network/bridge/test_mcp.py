"""`taskrpc bridge mcp`: its options. `tests/bridges/mcp/test_serving.py` runs it."""

import sys

import pytest

from taskrpc.cli import main
from taskrpc.cli.network.bridge import mcp


@pytest.mark.parametrize(
    ("options", "status", "problem"),
    [
        (["--http", "8765"], 2, "argument --http: expected HOST:PORT"),
        (["--http", "0.0.0.0:0"], 2, "expected an address of this machine such as 127.0.0.1:8765"),
        (["--http", "127.0.0.1:0"], 2, "--http needs --token-file FILE, with"),
        (["--token-file", "missing"], 1, "--token-file missing: "),
        (["--map", "missing.yaml"], 1, "cannot read the map"),
    ],
)
def test_mistake_in_the_options_gives_one_message(options, status, problem, capsys):
    pytest.importorskip("mcp_types")
    assert main.main(["bridge", "mcp", *options]) == status
    assert problem in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "status", "problem"),
    [
        (["--policy", "door.yaml"], 2, "expected --policy FILE and --as NAME together"),
        (["--as", "agents"], 2, "expected --policy FILE and --as NAME together"),
        (["--policy", "door.yaml", "--as", "agent"], 1, "has no rules for 'agent'"),
        (["--policy", "wrong.yaml", "--as", "agents"], 1, "wrong.yaml:1:"),
        (["--policy", "missing.yaml", "--as", "agents"], 1, "cannot read the policy"),
    ],
)
def test_mistake_in_the_policy_gives_one_message(
    options, status, problem, tmp_path, monkeypatch, capsys
):
    pytest.importorskip("mcp_types")
    monkeypatch.chdir(tmp_path)
    for name, text in ("door.yaml", "agents: {may: [call /x]}"), ("wrong.yaml", "agents: {my: 1}"):
        (tmp_path / name).write_text(text)
        (tmp_path / name).chmod(0o644)
    assert main.main(["bridge", "mcp", *options]) == status
    assert problem in capsys.readouterr().err


def test_token_that_can_be_guessed_is_refused(tmp_path, capsys):
    pytest.importorskip("mcp_types")
    file = tmp_path / "token"
    file.touch(0o600)
    file.write_text("secret")
    options = ["--http", "127.0.0.1:0", "--token-file", str(file)]
    assert main.main(["bridge", "mcp", *options]) == 2
    assert "expected at least 16 characters in" in capsys.readouterr().err


def test_token_of_a_lab_is_not_that_of_an_agent(monkeypatch, capsys):
    pytest.importorskip("mcp_types")
    monkeypatch.setenv("TASKRPC_TOKEN", "the secret of a lab")
    assert main.main(["bridge", "mcp", "--http", "127.0.0.1:0"]) == 2
    assert "--http needs --token-file FILE" in capsys.readouterr().err


def test_missing_package_gives_one_line(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mcp.server", None)
    assert main.main(["bridge", "mcp"]) == 1
    assert capsys.readouterr().err == (
        "taskrpc bridge mcp needs the package mcp 2.3 or newer: pip install 'taskrpc[mcp]'\n"
    )


@pytest.mark.skipif(sys.platform != "linux", reason="other systems have no such folder")
def test_registry_of_the_user_is_found_in_a_bare_environment(tmp_path):
    bare, set_already = {}, {"XDG_RUNTIME_DIR": "/mine"}
    mcp.find_runtime_folder(bare, tmp_path)
    mcp.find_runtime_folder(set_already, tmp_path)
    assert bare == {"XDG_RUNTIME_DIR": str(tmp_path)}
    assert set_already == {"XDG_RUNTIME_DIR": "/mine"}
    missing = {}
    mcp.find_runtime_folder(missing, tmp_path / "missing")
    assert missing == {}
