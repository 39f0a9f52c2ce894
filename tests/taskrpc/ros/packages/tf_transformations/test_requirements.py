"""Without transforms3d the import fails with one line."""

import importlib
import importlib.util
import sys

import pytest


def test_import_names_the_missing_package_and_the_remedy(monkeypatch):
    monkeypatch.delitem(
        sys.modules, "taskrpc.ros.packages.tf_transformations.requirements", raising=False
    )
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(ModuleNotFoundError, match=r"needs: pip install transforms3d$"):
        importlib.import_module("taskrpc.ros.packages.tf_transformations.requirements")
