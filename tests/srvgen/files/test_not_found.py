"""The suggestions for a package that cannot be found."""

import pytest

from srvgen.files.not_found import unknown_package


@pytest.mark.parametrize(
    ("package", "hint"),
    [
        ("px_msgs", "did you mean px4_msgs?"),
        ("sdt_msgs", "did you mean std_msgs?"),
        ("nav_msg", "did you mean nav_msgs?"),
        ("nowhere_msgs", ""),  # resembles hri_msgs, but not without _msgs
        ("zed_msgs", ""),
    ],
)
def test_common_ending_alone_suggests_no_package(package, hint, tmp_path):
    names = ("std_msgs", "nav_msgs", "px4_msgs", "hri_msgs")
    packages = {name: [tmp_path / name] for name in names}
    error = unknown_package(package, packages, [tmp_path], None)
    assert (error.message, error.hint) == (f"package {package!r} not found", hint)
