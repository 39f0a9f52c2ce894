"""Launch files in XML: ROS's package `launch_xml`.

`parser` reads a file into elements. What the elements mean is in `launch.frontend`. Start there to
add an element.
"""

from .entity import Entity
from .parser import Parser

__all__ = ["Entity", "Parser"]
