"""The notebooks of the labs run in real kernels, with the solutions filled in."""

from pathlib import Path

import pytest

pytestmark = [pytest.mark.notebooks, pytest.mark.real_time]
nbclient = pytest.importorskip("nbclient", reason="the extra `notebooks` is not installed")
nbformat = pytest.importorskip("nbformat", reason="the extra `notebooks` is not installed")

from taskrpc.course.labs.catalogue import LABS, lab  # noqa: E402
from taskrpc.course.labs.starter import filled  # noqa: E402
from taskrpc.course.labs.variants import Variant  # noqa: E402
from tests.notebooks.tidy import NOTEBOOKS  # noqa: E402

SOLUTIONS = Path(__file__).parents[2] / "examples" / "labs"
LONGEST = 120
"""Seconds that a cell may take on a busy machine."""


def with_solution(number):
    """The notebook of a lab, in which the student's cells are the solution."""
    notebook = nbformat.read(NOTEBOOKS / f"lab{number}.ipynb", as_version=4)
    nbformat.validate(notebook)
    values = lab(number).values(Variant())
    folder = SOLUTIONS / f"lab{number}" / "solution"
    files = {
        filled(path.relative_to(folder).as_posix(), values): filled(path.read_text("utf-8"), values)
        for path in folder.rglob("*")
        if path.is_file()
    }
    for cell in notebook.cells:
        name = cell.source.partition("\n")[0].removeprefix("%%lab ")
        if cell.source.startswith("%%lab ") and name in files:
            cell.source = f"%%lab {name}\n{files[name]}"
    return notebook


def printed(cell):
    """What a cell has written, also later."""
    return "".join(each.text for each in cell.outputs if each.output_type == "stream")


@pytest.mark.parametrize("number", [each.number for each in LABS])
def test_notebook_runs_and_its_solution_passes(number, tmp_path, monkeypatch):
    runtime = tmp_path / "run"
    runtime.mkdir(mode=0o700)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(runtime))
    monkeypatch.setenv("PYTHONWARNINGS", "default")
    notebook = with_solution(number)
    client = nbclient.NotebookClient(
        notebook, timeout=LONGEST, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute()
    [check] = [each for each in notebook.cells if each.source == "notebook.check()"]
    output = printed(check)
    for each in lab(number).checks:
        assert f"ok    {each.title}" in output, output
    for cell in (each for each in notebook.cells if each.cell_type == "code"):
        raises = any(each.output_type == "error" for each in cell.outputs)
        assert raises == ("raises-exception" in cell.metadata.get("tags", ())), cell.source
        assert "Exception ignored" not in printed(cell)
