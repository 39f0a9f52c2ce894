"""The parts that XML and YAML launch files share.

`substitution_text` reads texts with `$(…)`; `parser` turns elements into actions, with the tables
in `elements` and in `launch_ros`. The formats themselves are in `launch_xml` and `launch_yaml`.
"""

from .entity import Entity
from .expose import expose_action, expose_substitution
from .parser import Parser

__all__ = ["Entity", "Parser", "expose_action", "expose_substitution"]
