"""The module that an environment imports at each start of Python after `taskrpc ros enable`.

The command copies this file into the environment. Every start of Python pays for it, so it imports
only modules that Python has already loaded. It installs the real import hook when a program imports
a package of ROS. After taskrpc was removed, it does nothing.
"""

import os
import sys

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from importlib.machinery import ModuleSpec

_KINDS = ("srv", "msg", "action")
_MANIFESTS = ("package.xml", "setup.py")
_NAMES = ("rclpy", "tf2_ros")  # the import of tf2_ros is explained if it is missing

_OF_PYTHON = ("sitecustomize", "usercustomize")  # each start of Python tries to import them
_MOST = 100
"""Most names in a folder that are read: a workspace has few."""

_over = False
_found_bundled: "list[str]" = []


def begin() -> "None":
    """Watch for imports of `rclpy` and of interface packages."""
    finders = sys.meta_path
    python = [n for n, each in enumerate(finders) if getattr(each, "__name__", "") == "PathFinder"]
    # One watcher before Python's own finder, which would import a folder of definitions as a
    # package; and one after it, for packages that it does not find.
    finders.insert(python[0] if python else 0, _Watcher(_has_definitions_here))
    finders.append(_Watcher(_may_be_known))


class _Watcher:
    """Installs the real hook when a program imports a package that the hook may find."""

    def __init__(self, is_wanted: "Callable[[str], bool]") -> "None":
        self.is_wanted = is_wanted

    def find_spec(
        self, name: "str", path: "Sequence[str] | None" = None, target: "object" = None
    ) -> "ModuleSpec | None":
        global _over
        if _over or path is not None or name in _OF_PYTHON or name in sys.stdlib_module_names:
            return None
        if not self.is_wanted(name):
            return None
        _over = True  # the hook itself imports
        try:
            from taskrpc.ros import hook
        except ImportError:  # taskrpc was removed
            return None
        if hook.real_rclpy():
            return None
        hook.install(*_search_folders())
        for finder in sys.meta_path:
            if (spec := finder.find_spec(name, None)) is not None:
                return spec
        return None


def _has_definitions_here(name: "str") -> "bool":
    return any(_has_definitions(os.path.join(folder, name)) for folder in _search_folders())


def _may_be_known(name: "str") -> "bool":
    """Whether the hook may find a package, in any of the places where it searches."""
    if name in _NAMES or any(os.path.isdir(os.path.join(one, name)) for one in _bundled()):
        return True
    if _bundled() and _is_in_archive(f"{_bundled()[0]}.zip", name):
        return True
    folders = _search_folders()
    if any(_is_in_a_package(folder) or _has_packages(folder) for folder in folders):
        return True
    roots = [os.path.join(folder, "src") for folder in folders]
    roots += os.environ.get("TASKRPC_INTERFACE_PATH", "").split(os.pathsep)
    return any(_has_definitions(os.path.join(root, name)) for root in roots if root)


def _is_in_archive(archive: "str", name: "str") -> "bool":
    from zipimport import ZipImportError, zipimporter

    try:
        return bool(zipimporter(archive).get_data(f"{name}.txt"))
    except (OSError, ZipImportError):
        return False


def _has_definitions(folder: "str") -> "bool":
    return os.path.isdir(folder) and any(
        os.path.isdir(os.path.join(folder, kind)) for kind in _KINDS
    )


def _is_in_a_package(folder: "str") -> "bool":
    while not any(os.path.isfile(os.path.join(folder, name)) for name in _MANIFESTS):
        above = os.path.dirname(folder)
        if above == folder:
            return False
        folder = above
    return True


def _has_packages(folder: "str") -> "bool":
    """Whether a folder is a workspace: packages of ROS in `src` or its subfolders."""
    level = [os.path.join(folder, "src")]
    for _ in range(2):
        level = [os.path.join(each, name) for each in level for name in _names_in(each)]
        if any(os.path.isfile(os.path.join(each, _MANIFESTS[0])) for each in level):
            return True
    return False


def _names_in(folder: "str") -> "list[str]":
    try:
        return os.listdir(folder)[:_MOST]
    except OSError:
        return []


def _bundled() -> "list[str]":
    """The folders with the packages that taskrpc contains; none if taskrpc was removed."""
    if not _found_bundled:
        from importlib.machinery import PathFinder

        for package, inner in (("srvgen", "interfaces"), ("taskrpc", "ros/packages")):
            spec = PathFinder.find_spec(package)
            if spec is not None and spec.origin:
                _found_bundled.append(os.path.join(os.path.dirname(spec.origin), inner))
    return _found_bundled


def _search_folders() -> "list[str]":
    """The script's folder, the first folder in `sys.path`, and the working directory."""
    script = sys.argv[0] if getattr(sys, "argv", None) else ""
    try:
        here = os.getcwd()
    except OSError:  # deleted
        here = ""
    script_folder = os.path.dirname(os.path.abspath(script)) if os.path.isfile(script) else ""
    first = sys.path[0] if sys.path else ""
    return [folder for folder in dict.fromkeys((script_folder, first, here)) if folder]
