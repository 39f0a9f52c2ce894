"""A package that needs NumPy or OpenCV names the command that installs it."""

import sys

import pytest

from taskrpc.ros.optional import needed


def test_missing_module_is_explained_in_one_line(monkeypatch):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(ModuleNotFoundError) as caught:
        needed("cv2", "a compressed image")
    said = "a compressed image needs cv2: pip install opencv-python-headless"
    assert (str(caught.value), caught.value.name) == (said, "cv2")


def test_existing_module_is_returned():
    assert needed("os.path", "a test") is __import__("os").path
