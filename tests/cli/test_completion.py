"""What the TAB key completes: verbs, options and the names that running programs have."""

import pytest

from tests.cli.completing import completed

pytestmark = pytest.mark.real_time


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("serv", ["service"]),
        ("service ca", ["call"]),
        ("service list --inc", ["--include-hidden-services"]),
        ("service call /add", ["/add_two_ints"]),
        ("service call /add_two_ints ", ["example_interfaces/srv/AddTwoInts"]),
        ("service call /nobody std_srvs/srv/E", ["std_srvs/srv/Empty"]),
        ("service type -s /sl", ["/sleep"]),
        ("topic echo /t", ["/told"]),
        ("topic pub /heard ", ["std_msgs/msg/String"]),
        ("topic pub /new std_msgs/msg/Str", ["std_msgs/msg/String"]),
        ("topic hz /told /h", ["/heard"]),
        ("node info /", ["/add_two_ints_server", "/other"]),
        ("param get /oth", ["/other"]),
        ("interface show std_srvs/srv/Tr", ["std_srvs/srv/Trigger"]),
        ("pkg prefix example_", ["example_interfaces"]),
        ("run lamp ", ["glow", "shine.py"]),
        ("run la", ["lamp"]),
        ("run lamp shine.py ", []),
        ("scene dead", ["deadlock"]),
        ("daemon status ", []),
        ("topic echo --qos-depth ", []),
        ("topic echo --qos-depth 5 --csv /to", ["/told"]),
    ],
)
def test_tab_completes(server, tmp_path, monkeypatch, line, expected):
    package = tmp_path / "src" / "lamp"
    package.mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>lamp</name></package>")
    (package / "setup.py").write_text(
        "setup(entry_points={'console_scripts': ['glow = lamp.glow:main']})"
    )
    (package / "shine.py").touch()
    (package / "CMakeLists.txt").write_text("install(PROGRAMS shine.py DESTINATION lib/lamp)")
    monkeypatch.chdir(tmp_path)
    assert completed(line, monkeypatch) == expected
