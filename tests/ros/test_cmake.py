"""The installed programs and modules are read from CMakeLists.txt without CMake."""

import pytest

from taskrpc.ros import cmake


@pytest.fixture
def package(tmp_path):
    """Writes a package and its CMakeLists.txt; returns the relative paths that it installs."""
    folder = tmp_path / "folder"
    for name in (
        *("python/lib/__init__.py", "python/lib/math.py", "python/other/__init__.py"),
        *("python/alone.py", "scripts/talk.py", "scripts/deep/listen", "scripts/data.txt"),
        *("nodes/run_it.py", "plain/one.py", "launch/start.py"),
    ):
        file = folder / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text("#!/usr/bin/env python3\n" if "." not in file.name else "")

    def write(text):
        (folder / "CMakeLists.txt").write_text(f"project(pkg)\n{text}\n")

        def relative(found):
            return {name: path.relative_to(folder).as_posix() for name, path in found.items()}

        return relative(cmake.programs(folder)), relative(cmake.modules(folder))

    return write


@pytest.mark.parametrize(
    ("text", "programs"),
    [
        ("install(PROGRAMS scripts/talk.py DESTINATION lib/pkg)", {"talk.py": "scripts/talk.py"}),
        (
            "INSTALL( PROGRAMS scripts/talk.py # the first\n PERMISSIONS OWNER_EXECUTE\n"
            ' DESTINATION "lib/${PROJECT_NAME}" RENAME talk )',
            {"talk": "scripts/talk.py"},
        ),
        (
            "install(FILES nodes/run_it.py DESTINATION lib/${PROJECT_NAME} RENAME run_it)",
            {"run_it": "nodes/run_it.py"},
        ),
        (
            "install(DIRECTORY scripts/ DESTINATION lib/${PROJECT_NAME} USE_SOURCE_PERMISSIONS)",
            {"talk.py": "scripts/talk.py", "listen": "scripts/deep/listen"},
        ),
        (
            "set(NODES nodes/run_it.py;scripts/talk.py)\n"
            "install(PROGRAMS ${NODES} DESTINATION lib/${PROJECT_NAME})",
            {"run_it.py": "nodes/run_it.py", "talk.py": "scripts/talk.py"},
        ),
        (
            "file(GLOB SCRIPTS CONFIGURE_DEPENDS scripts/*.py **x\n"
            " ${CMAKE_CURRENT_SOURCE_DIR}/nodes/*)\n"
            "install(PROGRAMS ${SCRIPTS} DESTINATION lib/${PROJECT_NAME})",
            {"talk.py": "scripts/talk.py", "run_it.py": "nodes/run_it.py"},
        ),
        (
            "file(GLOB_RECURSE ALL RELATIVE ${CMAKE_CURRENT_SOURCE_DIR} listen ../*.py /*)\n"
            "install(PROGRAMS ${ALL} DESTINATION lib/${PROJECT_NAME})",
            {"listen": "scripts/deep/listen"},
        ),
        (
            "set(A scripts/talk)\nforeach(each IN LISTS A)\nforeach(inner one nodes/run_it)\n"
            "install(PROGRAMS ${inner}.py DESTINATION lib/x)\nendforeach()\n"
            "install(PROGRAMS ${each}.py DESTINATION lib/x RENAME talk)\nendforeach()",
            {"run_it.py": "nodes/run_it.py", "talk": "scripts/talk.py"},
        ),
        ("foreach(each IN LISTS NONE)\ninstall(PROGRAMS scripts/talk.py DESTINATION lib/x)", {}),
        ("#[[ install(PROGRAMS scripts/talk.py DESTINATION lib/pkg) ]]", {}),
        ("install(DIRECTORY launch scripts DESTINATION share/${PROJECT_NAME})", {}),
        ("install(PROGRAMS missing.py DESTINATION lib/pkg)", {}),
        ("install(PROGRAMS", {}),
    ],
)
def test_programs_are_the_installed_python_files(package, text, programs):
    assert package(text) == (programs, {})


@pytest.mark.parametrize(
    ("text", "modules"),
    [
        ("ament_python_install_package(${PROJECT_NAME})", {}),
        ("ament_python_install_package(pkg PACKAGE_DIR python/lib)", {"pkg": "python/lib"}),
        (
            'ament_python_install_package(${PROJECT_NAME}_py\n  PACKAGE_DIR "python/lib")',
            {"pkg_py": "python/lib"},
        ),
        (
            "ament_python_install_package(x PACKAGE_DIR ${CMAKE_CURRENT_SOURCE_DIR}/python/lib)",
            {"x": "python/lib"},
        ),
        ("ament_python_install_module(python/alone.py)", {"alone": "python/alone.py"}),
        (
            "ament_python_install_module(python/alone.py DESTINATION_SUFFIX inner)",
            {"inner.alone": "python/alone.py"},
        ),
        (
            "install(DIRECTORY python/lib/ DESTINATION ${PYTHON_INSTALL_DIR}/renamed)",
            {"renamed": "python/lib"},
        ),
        ("install(DIRECTORY python/lib DESTINATION ${PYTHON_INSTALL_DIR})", {"lib": "python/lib"}),
        (
            "install(DIRECTORY python/ DESTINATION lib/python3.12/site-packages)",
            {"alone": "python/alone.py", "lib": "python/lib", "other": "python/other"},
        ),
        (
            "install(DIRECTORY python/lib DESTINATION ${PYTHON_INSTALL_DIR}/outer)",
            {"outer.lib": "python/lib"},
        ),
        (
            "install(FILES plain/one.py DESTINATION ${PYTHON_INSTALL_DIR} RENAME two.py)",
            {"two": "plain/one.py"},
        ),
        (
            "install(FILES plain/one.py python/lib/__init__.py"
            " DESTINATION ${PYTHON_INSTALL_DIR}/made)",
            {"made.one": "plain/one.py", "made": "python/lib/__init__.py"},
        ),
    ],
)
def test_modules_have_their_installed_names(package, text, modules):
    assert package(text) == ({}, modules)


def test_package_without_readable_cmakelists_installs_nothing(tmp_path):
    assert cmake.programs(tmp_path) == cmake.modules(tmp_path) == {}
    (tmp_path / "CMakeLists.txt").write_bytes(b'install(PROGRAMS \xff\x00 ${A} "' + b"(" * 500)
    assert cmake.programs(tmp_path) == cmake.modules(tmp_path) == {}


@pytest.mark.parametrize("inner", ["", "set(b 1)\n"])
def test_nested_loops_are_read_up_to_a_limit(package, inner):
    loops = "foreach(a 1 2 3 4 5 6 7 8 9 10)\n" * 12 + inner + "endforeach()\n" * 12
    assert package(loops) == ({}, {})
