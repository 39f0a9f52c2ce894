"""Imports a module that a ROS package needs and taskrpc does not install."""

from __future__ import annotations

from importlib import import_module
from typing import Any

_ON_PYPI = {"cv2": "opencv-python-headless"}


def needed(module: str, by: str) -> Any:
    """The module; an ImportError names the command that installs it.

    Args:
        module: the name that Python imports.
        by: what needs it, for the error.
    """
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module.partition(".")[0]:
            raise
        advice = f"{by} needs {module}: pip install {_ON_PYPI.get(module, module)}"
        raise ModuleNotFoundError(advice, name=module) from None
