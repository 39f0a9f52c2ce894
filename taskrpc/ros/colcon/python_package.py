"""The files of an `ament_python` package."""

from __future__ import annotations

from collections.abc import Mapping

from taskrpc.ros.colcon.manifest import Manifest, package_xml

_LINTERS = {
    "copyright": ("main", "main(argv=['.', 'test'])", "a copyright notice is missing"),
    "flake8": ("main_with_errors", "main_with_errors(argv=[])[0]", "its style is not ROS-like"),
    "pep257": ("main", "main(argv=['.', 'test'])", "a docstring is not as ROS 2 wants it"),
}


def python_files(package: Manifest, executables: Mapping[str, str]) -> dict[str, str]:
    """The files of a package without its modules, by their paths from the package's folder.

    Args:
        package: the contents of its `package.xml`.
        executables: the executables by name, each with its `module:function`.
    """
    name = package.name
    files = {
        "package.xml": package_xml(package),
        "setup.py": _setup_py(package, executables),
        "setup.cfg": _setup_cfg(name),
        f"resource/{name}": "",
        f"{name}/__init__.py": "",
    }
    if package.is_linted:
        files |= {f"test/test_{linter}.py": _linter_test(linter) for linter in _LINTERS}
    return files


def hello_node(package: str) -> str:
    """The text of a module that prints a greeting."""
    return (
        f"def main():\n    print('Hi from {package}.')\n\n\n"
        "if __name__ == '__main__':\n    main()\n"
    )


def _setup_py(package: Manifest, executables: Mapping[str, str]) -> str:
    scripts = "".join(
        f"            '{name} = {target}',\n" for name, target in sorted(executables.items())
    )
    return f"""from setuptools import find_packages, setup

package_name = '{package.name}'

setup(
    name=package_name,
    version='{package.version}',
    packages=find_packages(exclude=['test']),
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer={package.maintainer!r},
    maintainer_email={package.email!r},
    description={package.description!r},
    license={package.license!r},
    extras_require={{'test': ['pytest']}},
    entry_points={{
        'console_scripts': [
{scripts}        ],
    }},
)
"""


def _setup_cfg(name: str) -> str:
    # ros2 run looks in this folder; by default setuptools installs into bin.
    folder = f"$base/lib/{name}"
    return f"[develop]\nscript_dir={folder}\n[install]\ninstall_scripts={folder}\n"


def _linter_test(linter: str) -> str:
    imported, call, problem = _LINTERS[linter]
    return (
        f"from ament_{linter}.main import {imported}\nimport pytest\n\n\n"
        f"@pytest.mark.{linter}\n@pytest.mark.linter\ndef test_{linter}():\n"
        f"    assert {call} == 0, '{problem}'\n"
    )
