"""The files of an `ament_cmake` package: empty, with a C++ node or library, or of definitions.

The C++ library has the sources that `ros2 pkg create --library-name` writes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from taskrpc.ros.colcon.manifest import Manifest, package_xml

_BEGINNING = """cmake_minimum_required(VERSION 3.8)
project({name})

if(CMAKE_COMPILER_IS_GNUCXX OR CMAKE_CXX_COMPILER_ID MATCHES "Clang")
  add_compile_options(-Wall -Wextra -Wpedantic)
endif()
"""
_EXECUTABLE = """add_executable({node} src/{node}.cpp)
target_include_directories({node} PUBLIC
  $<BUILD_INTERFACE:${{CMAKE_CURRENT_SOURCE_DIR}}/include>
  $<INSTALL_INTERFACE:include/${{PROJECT_NAME}}>)
target_compile_features({node} PUBLIC c_std_99 cxx_std_17)
{needs}install(TARGETS {node}
  DESTINATION lib/${{PROJECT_NAME}})
"""
_LIBRARY = """add_library({library} src/{library}.cpp)
add_library(${{PROJECT_NAME}}::{library} ALIAS {library})
target_compile_features({library} PUBLIC c_std_99 cxx_std_17)
target_include_directories({library} PUBLIC
  $<BUILD_INTERFACE:${{CMAKE_CURRENT_SOURCE_DIR}}/include>
  $<INSTALL_INTERFACE:include/${{PROJECT_NAME}}>)
{needs}# On Windows, the build of the library exports its symbols, and its users import them.
target_compile_definitions({library} PRIVATE "{shouted}_BUILDING_LIBRARY")
install(DIRECTORY include/
  DESTINATION include/${{PROJECT_NAME}})
install(TARGETS {library}
  EXPORT export_${{PROJECT_NAME}}
  ARCHIVE DESTINATION lib
  LIBRARY DESTINATION lib
  RUNTIME DESTINATION bin)
"""
_EXPORTED = """ament_export_include_directories("include/${{PROJECT_NAME}}")
ament_export_libraries({library})
ament_export_targets(export_${{PROJECT_NAME}})
"""
_TESTS = """if(BUILD_TESTING)
  find_package(ament_lint_auto REQUIRED)
  # Both need what a new package does not have yet: a copyright notice, a git repository.
  set(ament_cmake_copyright_FOUND TRUE)
  set(ament_cmake_cpplint_FOUND TRUE)
  ament_lint_auto_find_test_dependencies()
endif()
"""

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


def cmake_files(package: Manifest, node: str = "", library: str = "") -> dict[str, str]:
    """The files of a package, by their paths from its folder.

    Args:
        package: the contents of its `package.xml`.
        node: the name of a C++ program, "" for none.
        library: the name of a C++ library, "" for none.
    """
    needs = ["ament_cmake_ros" if library else "ament_cmake", *package.depends]
    if library:
        package = replace(package, buildtool="ament_cmake_ros")
    parts = [_BEGINNING.format(name=package.name), _found(needs)]
    end = ["ament_package()\n"]
    files = {"package.xml": package_xml(package)}
    if library:
        uses = _uses(package, library)
        shouted = package.name.upper()
        parts.append(_LIBRARY.format(library=library, needs=uses, shouted=shouted))
        end.insert(0, _EXPORTED.format(library=library))
        files |= _library_sources(package.name, library)
    if node:
        uses = _uses(package, node)
        if library:
            uses += f"target_link_libraries({node} {library})\n"
        parts.append(_EXECUTABLE.format(node=node, needs=uses))
        files[f"src/{node}.cpp"] = _hello(package.name, library)
    files["CMakeLists.txt"] = "\n".join([*parts, _TESTS, *end])
    return files


def _uses(package: Manifest, target: str) -> str:
    linked = "".join(f"  {name}\n" for name in package.depends)
    return f"ament_target_dependencies({target}\n{linked})\n" if linked else ""


def interface_files(package: Manifest, definitions: Sequence[str]) -> dict[str, str]:
    """The files of a package of definitions, without the definitions.

    Args:
        package: the contents of its `package.xml`; `depends` are the packages that the definitions
            refer to.
        definitions: their paths from the package's folder, such as `srv/AddTwoInts.srv`.
    """
    needs = ["ament_cmake", "rosidl_default_generators", *package.depends]
    listed = "".join(f'\n  "{path}"' for path in definitions)
    others = f"\n  DEPENDENCIES {' '.join(package.depends)}" if package.depends else ""
    text = "\n".join(
        [
            f"cmake_minimum_required(VERSION 3.8)\nproject({package.name})\n",
            _found(needs),
            f"rosidl_generate_interfaces(${{PROJECT_NAME}}{listed}{others}\n)\n",
            "ament_export_dependencies(rosidl_default_runtime)\nament_package()\n",
        ]
    )
    return {"package.xml": package_xml(package), "CMakeLists.txt": text}


def _found(packages: Iterable[str]) -> str:
    return "".join(f"find_package({name} REQUIRED)\n" for name in packages)


def _hello(package: str, library: str) -> str:
    included, used = "", ""
    if library:
        included = f'#include "{package}/{library}.hpp"\n'
        used = f"  {package}::{_class_name(library)} unused;\n  (void)unused;\n"
    return (
        f"#include <cstdio>\n{included}\nint main()\n{{\n{used}"
        f'  std::printf("hello world {package} package\\n");\n  return 0;\n}}\n'
    )


def _library_sources(package: str, library: str) -> dict[str, str]:
    """The sources of an empty library, by their paths from the package's folder."""
    names = {
        "package": package,
        "library": library,
        "class_name": _class_name(library),
        "guard": package.upper(),
        "upper": library.upper(),
    }
    return {
        f"include/{package}/{library}.hpp": _HEADER.format(**names),
        f"include/{package}/visibility_control.h": _VISIBILITY.format(**names),
        f"src/{library}.cpp": _SOURCE.format(**names),
    }


def _class_name(library: str) -> str:
    """The name of the class in a library."""
    return library.replace("_", " ").title().replace(" ", "")
