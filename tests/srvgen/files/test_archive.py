"""Packages in srvgen's archive are found and loaded like those in folders."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

import srvgen
from srvgen.errors import DefinitionError
from srvgen.files import archive
from srvgen.files.archive import ARCHIVE
from srvgen.files.reading import KINDS, read_definition, read_text
from srvgen.files.search import BUNDLED, Search
from srvgen.typehash import hash_of

ROOT = Path(__file__).parents[3]
SOURCES = ROOT / "srvgen" / "public_interfaces"
HASHES = Path(__file__).parents[1] / "public_hashes.txt"
OFFICIAL = dict(
    line.split()
    for line in HASHES.read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
)
search = Search([ARCHIVE])
NAMES = [name for package in archive.packages() for name in search.interfaces(package)]


@pytest.fixture
def packing():
    spec = importlib.util.spec_from_file_location("pack", SOURCES / "pack.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_archive_has_the_definitions_of_the_source_folder(packing):
    packed = {package: dict(archive.definitions(package)) for package in archive.packages()}
    assert packed == packing.packages(), "run: python srvgen/public_interfaces/pack.py"


def test_no_package_is_in_both_places():
    assert not {path.name for path in BUNDLED.iterdir()} & set(archive.packages())


@pytest.mark.parametrize("package", archive.packages())
def test_every_definition_and_all_that_it_nests_are_valid(package):
    for name in search.interfaces(package):
        assert hash_of(search.with_dependencies(name)[-1], search.load).startswith("RIHS01_")


@pytest.mark.parametrize("package", archive.packages())
def test_definitions_have_no_comments_and_no_blank_lines(package):
    for name, text in archive.definitions(package).items():
        assert name.split("/")[0] in KINDS
        for line in text.splitlines():
            assert line.strip() == line, (name, line)
            assert line, name
            assert not line.startswith("#"), (name, line)


@pytest.mark.parametrize("name", OFFICIAL)
def test_type_has_the_hash_of_ros_2(name):
    assert hash_of(search.load(name), search.load) == OFFICIAL[name]


def test_a_file_in_the_archive_is_read_by_its_path():
    path = search.find("geographic_msgs/msg/GeoPoint")
    assert path == ARCHIVE / "geographic_msgs" / "msg" / "GeoPoint.msg"
    assert read_text(path) == "float64 latitude\nfloat64 longitude\nfloat64 altitude\n"
    assert read_definition(path).full_name == "geographic_msgs/msg/GeoPoint"
    with pytest.raises(DefinitionError, match="expected a readable file"):
        read_definition(path.with_name("GeoPlace.msg"))


def test_a_local_package_comes_first(tmp_path):
    folder = tmp_path / "geographic_msgs" / "msg"
    folder.mkdir(parents=True)
    (folder / "GeoPoint.msg").write_text("float32 north\n")
    local = Search([tmp_path])
    assert local.find("geographic_msgs/msg/GeoPoint") == folder / "GeoPoint.msg"
    assert local.find("geographic_msgs/msg/GeoPose").is_relative_to(ARCHIVE)
    assert len(local.packages()["geographic_msgs"]) == 2


def test_unknown_types_of_a_package_get_a_suggestion():
    with pytest.raises(DefinitionError, match="GeoPoint") as caught:
        search.load("geographic_msgs/msg/GeoPiont")
    assert "the packages of srvgen" in str(caught.value)
    assert archive.definitions("geographic_mags") == {}
    assert not search.has_package("packages")


def test_types_of_other_packages_are_suggested_before_those_of_the_archive(tmp_path):
    with pytest.raises(DefinitionError) as caught:
        Search([tmp_path]).load("my_msgs/msg/Point")
    assert "Point" not in caught.value.hint
    (tmp_path / "my_msgs" / "msg").mkdir(parents=True)
    (tmp_path / "my_msgs" / "msg" / "Line.msg").write_text("Point start\nGeoPoint end\n")
    with pytest.raises(DefinitionError) as caught:
        Search([tmp_path]).with_dependencies("my_msgs/msg/Line")
    text = str(caught.value)
    assert "did you mean geometry_msgs/Point?" in text
    assert "did you mean geographic_msgs/GeoPoint?" in text


def test_a_text_from_a_server_may_nest_types_of_the_archive():
    made = srvgen.define("map_msgs_test/msg/Place", "geographic_msgs/GeoPoint point\n")
    assert made().point.latitude == 0.0


def test_unpacked_package_is_a_folder_until_python_ends():
    folder = archive.unpacked("stereo_msgs")
    text = (folder / "msg" / "DisparityImage.msg").read_text(encoding="utf-8")
    assert text == archive.definitions("stereo_msgs")["msg/DisparityImage.msg"]
    assert archive.unpacked("stereo_msgs") == folder


def test_path_below_an_unpacked_package_belongs_to_it():
    folder = archive.unpacked("stereo_msgs")
    paths = [folder, folder / "launch" / "none.launch.py", folder.parent, "stereo_msgs/launch", ""]
    assert [archive.package_of(str(each)) for each in paths] == ["stereo_msgs"] * 2 + [""] * 3


@pytest.mark.real_time
def test_a_program_imports_a_package_of_the_archive():
    program = (
        "from geographic_msgs.msg import GeoPoint\n"
        "from ament_index_python import get_package_share_directory as share\n"
        "from rosidl_runtime_py import get_interface_path as path\n"
        "text = open(path('geographic_msgs/msg/GeoPoint')).read()\n"
        "print(GeoPoint(latitude=1.0).latitude, text[:7])\n"
        "print(share('geographic_msgs').endswith('geographic_msgs'))"
    )
    done = subprocess.run(
        [sys.executable, "-m", "taskrpc", "run", "-c", program],
        capture_output=True, text=True, check=False, timeout=60, cwd=ROOT,
    )  # fmt: skip
    assert done.stderr == ""
    assert done.stdout.splitlines()[:2] == ["1.0 float64", "True"]
