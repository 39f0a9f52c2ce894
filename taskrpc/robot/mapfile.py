"""Map files: reads YAML into a `World`; each error shows its line.

The bundled map, ``maps/default.yaml``, is also an example to copy.
"""

import contextlib
import math
from importlib import resources
from pathlib import Path

from taskrpc.robot.kinematics import Point
from taskrpc.robot.obstacles import Box
from taskrpc.robot.world import DOCK, World
from taskrpc.spi import read_text
from taskrpc.spi import yaml_document as documents

_LARGEST = 1000.0  # metres, for the width and the height
_ROBOT_RADIUS = 0.25  # metres, if the map has none


class MapError(documents.DocumentError):
    """A map file cannot be read, or it describes no map that the robot can use."""


def read_map(path: str | Path) -> World:
    """Read a map file.

    Raises:
        MapError: it cannot be read, is not YAML, or has a wrong value.
    """
    try:
        text = read_text(path, "utf-8-sig")
    except OSError as error:
        raise MapError(f"cannot read the map: {error.strerror or error}", str(path)) from None
    except UnicodeDecodeError:
        raise MapError("the map is not UTF-8 text; save it as UTF-8", str(path)) from None
    return parse_map(text, str(path))


def default_world() -> World:
    """Return the bundled map: 10 x 8 metres with a dock and four places."""
    file = resources.files("taskrpc.robot") / "maps" / "default.yaml"
    return parse_map(file.read_text(encoding="utf-8"), "default.yaml")


def parse_map(text: str, path: str = "map") -> World:
    """Read a map from its text; error messages name it `path`.

    Raises:
        MapError: as `read_map`.
    """
    document = documents.Document(text, path, what="the map", error=MapError)
    return _MapReader(document).world()


class _MapReader:
    def __init__(self, document: documents.Document) -> None:
        self._document = document
        self._fields = document.fields(
            document.root, "a map", ("size", "dock"), ("robot_radius", "walls", "boxes", "places")
        )
        self._size = self._read_size()

    def world(self) -> World:
        world = World(
            self._size,
            dock=self._point(self._fields["dock"], "dock"),
            obstacles=[*self._walls(), *self._boxes()],
            places=self._places(),
            robot_radius=self._robot_radius(),
        )
        self._check_standing_room(world, self._fields["dock"], DOCK)
        for key, value in self._place_entries():
            self._check_standing_room(world, value, key.value)
            if world.path(world.dock, world.places[key.value]) is None:
                self._document.fail(
                    value,
                    f"no way leads from the dock to {key.value!r}: walls are in between, or a gap "
                    f"is too narrow for the robot",
                )
        return world

    def _read_size(self) -> Point:
        node = self._fields["size"]
        width, height = self._numbers(node, "size", "width, height")
        if not (0.0 < width <= _LARGEST and 0.0 < height <= _LARGEST):
            self._document.fail(
                node, f"size: expected more than 0 and at most {_LARGEST:g} metres each way"
            )
        return width, height

    def _robot_radius(self) -> float:
        node = self._fields.get("robot_radius")
        if node is None:
            return _ROBOT_RADIUS
        radius = self._number(node, "robot_radius")
        if radius <= 0.0:
            self._document.fail(node, f"robot_radius: expected more than 0 metres, got {radius:g}")
        return radius

    def _walls(self) -> list[Box]:
        return [
            self._wall(node) for node in self._document.items(self._fields.get("walls"), "walls")
        ]

    def _wall(self, node: documents.Node) -> Box:
        x0, y0, x1, y1 = self._numbers(node, "a wall", "x, y, x, y")
        if (x0, y0) == (x1, y1):
            self._document.fail(node, "a wall: its two ends are the same point")
        self._check_inside(node, "a wall", (x0, y0), (x1, y1))
        return Box.wall((x0, y0), (x1, y1))

    def _boxes(self) -> list[Box]:
        return [
            self._box(node) for node in self._document.items(self._fields.get("boxes"), "boxes")
        ]

    def _box(self, node: documents.Node) -> Box:
        fields = self._document.fields(node, "a box", ("at", "size"))
        x, y = self._numbers(fields["at"], "a box's at", "x, y")
        width, height = self._numbers(fields["size"], "a box's size", "width, height")
        if width <= 0.0 or height <= 0.0:
            self._document.fail(
                fields["size"], "a box's size: expected more than 0 metres each way"
            )
        self._check_inside(node, "a box", (x, y), (x + width, y + height))
        return Box.rectangle((x, y), (width, height))

    def _place_entries(self) -> list[tuple[documents.Node, documents.Node]]:
        node = self._fields.get("places")
        return self._document.entries(node, "places") if node else []

    def _places(self) -> dict[str, Point]:
        places = {}
        for key, value in self._place_entries():
            if key.value == DOCK:
                self._document.fail(key, "a place cannot be named 'dock': the dock has this name")
            if not key.value.replace("-", "_").isidentifier():
                self._document.fail(
                    key,
                    f"a place cannot be named {key.value!r}: expected letters, digits, _ and -, "
                    f"beginning with a letter",
                )
            places[key.value] = self._point(value, key.value)
        return places

    def _point(self, node: documents.Node, what: str) -> Point:
        x, y = self._numbers(node, what, "x, y")
        self._check_inside(node, what, (x, y))
        return x, y

    def _check_inside(self, node: documents.Node, what: str, *points: Point) -> None:
        width, height = self._size
        for x, y in points:
            if not (0.0 <= x <= width and 0.0 <= y <= height):
                self._document.fail(
                    node,
                    f"{what} reaches to {x:g}, {y:g}, outside the map of {width:g} x {height:g} m",
                )

    def _check_standing_room(self, world: World, node: documents.Node, what: str) -> None:
        if not world.is_free(world.places[what]):
            self._document.fail(
                node,
                f"the robot cannot stand at {what!r}: a wall or box is nearer than its radius "
                f"of {world.robot_radius:g} m",
            )

    def _numbers(self, node: documents.Node, what: str, names: str) -> list[float]:
        """Return the numbers of a list that has one for each of the comma-separated `names`."""
        if node.id != "sequence" or len(node.value) != names.count(",") + 1:
            got = documents.describe(node)
            self._document.fail(node, f"{what}: expected [{names}] in metres, got {got}")
        return [self._number(item, what) for item in node.value]

    def _number(self, node: documents.Node, what: str) -> float:
        """Return a finite number."""
        value = math.nan
        if node.id == "scalar" and node.style is None:
            with contextlib.suppress(ValueError):
                value = float(node.value)
        if not math.isfinite(value):
            got = documents.describe(node)
            self._document.fail(node, f"{what}: expected a number in metres, got {got}")
        return value
