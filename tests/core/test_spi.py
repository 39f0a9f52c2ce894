"""`taskrpc.spi`: what the core offers to districts and to other packages."""

import subprocess
import sys

import pytest

from taskrpc import spi
from tests.source_tree import ROOT, imports


@pytest.mark.parametrize("name", spi.__all__)
def test_each_name_leads_to_what_type_checkers_see(name):
    seen = {}
    for module, inner in imports("taskrpc/spi.py", (ROOT / "taskrpc/spi.py").read_bytes()):
        seen[inner or module.rpartition(".")[2]] = (module, inner)
    module, inner = seen[name]
    __import__(module)
    expected = getattr(sys.modules[module], inner) if inner else sys.modules[module]
    assert getattr(spi, name) is expected


def test_an_unknown_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match=r"has no attribute 'Engin'"):
        _ = spi.Engin


@pytest.mark.real_time
def test_importing_the_module_loads_nothing_else_of_the_core():
    code = (
        "import sys, taskrpc.spi; print([each for each in sys.modules if 'taskrpc.core' in each])"
    )
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert ended.stdout == "[]\n"
