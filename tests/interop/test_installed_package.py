"""A package of another author, installed with pip into an environment of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.docs.markdown import read_page
from tests.interop.conftest import make_environment

ROOT = Path(__file__).parents[2]
PAGE = read_page(ROOT / "docs" / "how-to" / "extend-taskrpc.md")


def test_the_package_of_the_page_adds_its_transport_and_its_command(own_wheel, tmp_path):
    package = tmp_path / "package"
    package.mkdir()
    for block in PAGE.blocks:
        if block.file:
            (package / block.file).write_text(block.text + "\n", encoding="utf-8")
    home = tmp_path / "environment"
    make_environment(home)
    python = home / "bin" / "python"
    pip = [sys.executable, "-m", "pip", "--quiet", "--python", python]
    install = [*pip, "install", "--no-compile", own_wheel, package]
    subprocess.run(install, cwd=tmp_path, check=True)
    (tmp_path / "programs.py").write_bytes((package / "programs.py").read_bytes())
    called = [[home / "bin" / "taskrpc", "boxes", "3"], [python, "programs.py"]]
    said = [
        subprocess.run(each, cwd=tmp_path, capture_output=True, text=True, check=True).stdout
        for each in called
    ]
    assert said == [
        "the postbox is box 3\n",
        "example_interfaces.srv.AddTwoInts_Response(sum=5)\n"
        "the server has cancelled the call\nno response by the deadline\n",
    ]
