"""Checks of the lecturer, from a folder that students do not have: `labN/hidden.py`."""

from __future__ import annotations

import dataclasses
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

from taskrpc.course.labs.lab import Check, Lab
from taskrpc.errors import TaskRpcError


def hidden_checks(folder: Path, lab: Lab) -> tuple[Check, ...]:
    """Return the tuple CHECKS of `labN/hidden.py`; () if the folder has none for this lab.

    Raises TaskRpcError if there is no such folder, or the file is wrong.
    """
    if not folder.is_dir():
        raise TaskRpcError(f"--hidden: expected a folder with lab1/hidden.py, got {folder}")
    path = folder / f"lab{lab.number}" / "hidden.py"
    if not path.is_file():
        return ()
    name = f"taskrpc_hidden_lab{lab.number}"
    spec = spec_from_file_location(name, path)
    assert spec is not None, "the name ends with .py"
    assert spec.loader is not None, "the name ends with .py"
    module = module_from_spec(spec)
    sys.modules[name] = module
    try:
        spec.loader.exec_module(module)
        checks = tuple(module.CHECKS)
    except Exception as error:
        raise TaskRpcError(f"{path}: {type(error).__name__}: {error}") from error
    if not all(isinstance(each, Check) for each in checks):
        raise TaskRpcError(
            f"{path}: expected CHECKS to contain Check objects of taskrpc.course.labs.lab"
        )
    return checks


def with_checks(lab: Lab, more: tuple[Check, ...]) -> Lab:
    """Return the lab with further checks after its own."""
    return dataclasses.replace(lab, checks=(*lab.checks, *more))
