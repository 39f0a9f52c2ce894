"""The sources of an empty C++ library, as `ros2 pkg create --library-name` has them."""

from __future__ import annotations

_HEADER = """#ifndef {guard}__{upper}_HPP_
#define {guard}__{upper}_HPP_

#include "{package}/visibility_control.h"

namespace {package}
{{

class {class_name}
{{
public:
  {guard}_PUBLIC {class_name}();

  {guard}_PUBLIC virtual ~{class_name}();
}};

}}  // namespace {package}

#endif  // {guard}__{upper}_HPP_
"""
_SOURCE = """#include "{package}/{library}.hpp"

namespace {package}
{{

{class_name}::{class_name}()
{{
}}

{class_name}::~{class_name}()
{{
}}

}}  // namespace {package}
"""
_VISIBILITY = """#ifndef {guard}__VISIBILITY_CONTROL_H_
#define {guard}__VISIBILITY_CONTROL_H_

// {guard}_PUBLIC marks what users of the library may call, {guard}_LOCAL what they may not.
#if defined _WIN32 || defined __CYGWIN__
  #ifdef {guard}_BUILDING_LIBRARY
    #define {guard}_PUBLIC __declspec(dllexport)
  #else
    #define {guard}_PUBLIC __declspec(dllimport)
  #endif
  #define {guard}_LOCAL
#else
  #define {guard}_PUBLIC __attribute__ ((visibility("default")))
  #define {guard}_LOCAL  __attribute__ ((visibility("hidden")))
#endif

#endif  // {guard}__VISIBILITY_CONTROL_H_
"""


def library_sources(package: str, library: str) -> dict[str, str]:
    """The sources by their paths from the package's folder."""
    names = {
        "package": package,
        "library": library,
        "class_name": class_name(library),
        "guard": package.upper(),
        "upper": library.upper(),
    }
    return {
        f"include/{package}/{library}.hpp": _HEADER.format(**names),
        f"include/{package}/visibility_control.h": _VISIBILITY.format(**names),
        f"src/{library}.cpp": _SOURCE.format(**names),
    }


def class_name(library: str) -> str:
    """What the class in a library is called."""
    return library.replace("_", " ").title().replace(" ", "")
