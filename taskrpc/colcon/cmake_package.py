"""The files of an `ament_cmake` package: an empty one, one with a C++ node, one of interfaces."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from taskrpc.colcon.manifest import Manifest, package_xml

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
_TESTS = """if(BUILD_TESTING)
  find_package(ament_lint_auto REQUIRED)
  # Both need what a new package does not have yet: a copyright notice, a git repository.
  set(ament_cmake_copyright_FOUND TRUE)
  set(ament_cmake_cpplint_FOUND TRUE)
  ament_lint_auto_find_test_dependencies()
endif()
"""


def cmake_files(package: Manifest, node: str = "") -> dict[str, str]:
    """The files of a package, with a C++ program where it is named; paths from its folder."""
    needs = ["ament_cmake", *package.depends]
    parts = [_BEGINNING.format(name=package.name), _found(needs)]
    files = {"package.xml": package_xml(package)}
    if node:
        linked = "".join(f"  {name}\n" for name in package.depends)
        uses = f"ament_target_dependencies({node}\n{linked})\n" if linked else ""
        parts.append(_EXECUTABLE.format(node=node, needs=uses))
        files[f"src/{node}.cpp"] = _hello(package.name)
    files["CMakeLists.txt"] = "\n".join([*parts, _TESTS, "ament_package()\n"])
    return files


def interface_files(package: Manifest, definitions: Sequence[str]) -> dict[str, str]:
    """The files of a package around its definitions.

    Args:
        package: what it says of itself; `depends` are the packages that definitions refer to.
        definitions: their paths from the package's folder, `srv/AddTwoInts.srv`.
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


def _hello(package: str) -> str:
    return (
        "#include <cstdio>\n\nint main()\n{\n"
        f'  std::printf("hello world {package} package\\n");\n  return 0;\n}}\n'
    )
