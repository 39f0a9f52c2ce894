"""Paths are valid and shortest, a scan sees the obstacles, an error explains a wrong target."""

import heapq
import math
from itertools import combinations, pairwise, permutations

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from taskrpc.robot import Box, Pose, TargetError, World
from tests.properties import examples

SIZE = (8.0, 6.0)
RADIUS = 0.25

xs, ys = st.floats(0.3, 7.7), st.floats(0.3, 5.7)
points = st.tuples(xs, ys)
rectangles = st.builds(
    lambda x, y, w, h: Box.rectangle((x, y), (min(w, 7.9 - x), min(h, 5.9 - y))),
    st.floats(0.1, 7.0),
    st.floats(0.1, 5.0),
    st.floats(0.2, 3.0),
    st.floats(0.2, 3.0),
)
walls = st.tuples(points, points).filter(lambda w: math.dist(*w) > 0.2).map(lambda w: Box.wall(*w))
obstacles = st.lists(rectangles | walls, max_size=5)


def world_of(boxes, **more):
    return World(SIZE, dock=(1.0, 1.0), obstacles=boxes, robot_radius=RADIUS, **more)


def length(points):
    return math.fsum(math.dist(a, b) for a, b in pairwise(points))


def depths(box, point):
    """How far inside each of the four edges of a box a point is; rotated by complex numbers."""
    turned = complex(point[0] - box.x, point[1] - box.y) / complex(box.ux, box.uy)
    u, v = turned.real, turned.imag
    return box.half_length - u, box.half_length + u, box.half_width - v, box.half_width + v


def deepest(box, start, end):
    """How deep the straight line gets into a box: the greatest value of its least depth.

    The least of four linear functions is concave, so it peaks at an end or where two of them meet.
    """
    at_start, at_end = depths(box, start), depths(box, end)
    lines = [(a, b - a) for a, b in zip(at_start, at_end, strict=True)]
    shares = [0.0, 1.0]
    for (a, slope_a), (b, slope_b) in combinations(lines, 2):
        if slope_a != slope_b:
            shares.append(min(1.0, max(0.0, (b - a) / (slope_a - slope_b))))
    return max(min(a + share * slope for a, slope in lines) for share in shares)


def is_legal(boxes, start, end, slack):
    """Whether the middle of the robot stays out of every box grown by its radius."""
    return all(deepest(box.inflated(RADIUS), start, end) <= slack for box in boxes)


def grid_length(world, boxes, start, goal, cell=0.25):
    """Dijkstra over a grid with 16 directions; None if it finds no way."""
    columns, rows = round(SIZE[0] / cell), round(SIZE[1] / cell)
    nodes = {
        (i, j): (i * cell, j * cell)
        for i in range(columns + 1)
        for j in range(rows + 1)
        if world.is_free((i * cell, j * cell))
    }
    moves = [
        (a, b)
        for a in range(-2, 3)
        for b in range(-2, 3)
        if (a, b) != (0, 0) and math.gcd(a, b) == 1
    ]
    nodes["start"], nodes["goal"] = start, goal

    def neighbours(node):
        if node == "start":
            return [n for n, p in nodes.items() if math.dist(p, start) < 2 * cell]
        here = [(node[0] + a, node[1] + b) for a, b in moves]
        near_goal = ["goal"] if math.dist(nodes[node], goal) < 2 * cell else []
        return [n for n in here if n in nodes] + near_goal

    frontier, done = [(0.0, 0, "start")], set()
    pushed = 0
    while frontier:
        behind, _, node = heapq.heappop(frontier)
        if node == "goal":
            return behind
        if node in done:
            continue
        done.add(node)
        for onward in neighbours(node):
            if onward not in done and is_legal(boxes, nodes[node], nodes[onward], slack=-1e-6):
                pushed += 1
                step = math.dist(nodes[node], nodes[onward])
                heapq.heappush(frontier, (behind + step, pushed, onward))
    return None


@given(rectangles | walls, points, points)
def test_a_box_blocks_exactly_the_lines_that_lead_through_it(box, start, end):
    grown = box.inflated(RADIUS)
    depth = deepest(grown, start, end)
    assume(abs(depth) > 1e-8)
    assert grown.blocks(start, end) == (depth > 0)


@given(
    rectangles,
    st.integers(0, 3),
    st.floats(0.05, 1.5),
    st.floats(1e-6, 0.1) | st.floats(-0.1, -1e-6),
)
def test_a_line_past_a_corner_is_blocked_as_soon_as_it_cuts_it(box, which, slope, depth):
    """The line crosses the corner's diagonal at `depth` inside, or outside."""
    corner = box.corners()[which]
    inward = math.copysign(1, box.x - corner[0]), math.copysign(1, box.y - corner[1])
    assume(depth < min(box.half_length, box.half_width))
    through = corner[0] + depth * inward[0], corner[1] + depth * inward[1]
    along = inward[0], -slope * inward[1]
    start = through[0] - 5 * along[0], through[1] - 5 * along[1]
    end = through[0] + 5 * along[0], through[1] + 5 * along[1]
    assert box.blocks(start, end) == (depth > 0)


@settings(max_examples=examples(25))
@given(obstacles, points, points)
def test_no_way_over_a_dense_grid_is_shorter(boxes, start, goal):
    world = world_of(boxes)
    assume(world.is_free(start) and world.is_free(goal))
    on_grid = grid_length(world, boxes, start, goal)
    way = world.path(start, goal)
    if on_grid is not None:
        assert way is not None, "the grid found a way"
        assert length([start, *way]) <= on_grid + 1e-6


@settings(max_examples=examples(150))
@given(obstacles, points, points)
def test_a_way_is_legal_all_along_and_ends_at_the_goal(boxes, start, goal):
    world = world_of(boxes)
    assume(world.is_free(start) and world.is_free(goal))
    way = world.path(start, goal)
    if way is not None:
        assert way[-1] == goal
        assert all(is_legal(boxes, a, b, 1e-6) for a, b in pairwise([start, *way]))
        assert all(RADIUS - 1e-9 <= x <= SIZE[0] - RADIUS + 1e-9 for x, _ in way)
        assert all(RADIUS - 1e-9 <= y <= SIZE[1] - RADIUS + 1e-9 for _, y in way)


@settings(max_examples=examples(60))
@given(st.lists(rectangles | walls, min_size=1, max_size=2), points, points)
def test_no_sequence_of_corners_is_shorter(boxes, start, goal):
    """Few obstacles: try every way of up to three bends."""
    world = world_of(boxes)
    assume(world.is_free(start) and world.is_free(goal))
    corners = [c for box in boxes for c in box.inflated(RADIUS).corners() if world.is_free(c)]
    ways = [[start, *some, goal] for n in range(4) for some in permutations(corners, n)]
    ways.sort(key=length)
    legal = {}

    def leg(a, b):
        if (a, b) not in legal:
            legal[a, b] = is_legal(boxes, a, b, 1e-9)
        return legal[a, b]

    best = next((w for w in ways if all(leg(a, b) for a, b in pairwise(w))), None)
    way = world.path(start, goal)
    if best is None:
        assert way is None or len(way) > 4
    else:
        assert way is not None
        assert length([start, *way]) <= length(best) + 1e-6
        assert length([start, *way]) >= length(best) - 1e-6 or len(way) > 4


@settings(max_examples=examples(100))
@given(obstacles, points, points)
def test_the_way_back_is_as_long(boxes, start, goal):
    world = world_of(boxes)
    assume(world.is_free(start) and world.is_free(goal))
    there, back = world.path(start, goal), world.path(goal, start)
    assert (there is None) == (back is None)
    if there and back:
        assert length([start, *there]) == pytest.approx(length([goal, *back]))


@given(obstacles, points, points)
def test_two_equal_worlds_choose_the_same_way(boxes, start, goal):
    assert world_of(boxes).path(start, goal) == world_of(list(boxes)).path(start, goal)


def test_a_robot_does_not_stop_where_its_way_goes_straight_on():
    row = [Box.rectangle((x, 2.0), (0.5, 1.0)) for x in (2.0, 3.5, 5.0)]
    way = world_of(row).path((1.0, 1.75), (7.0, 1.75))
    assert way == ((7.0, 1.75),)
    way = world_of(row).path((1.0, 2.5), (7.0, 2.5))
    assert len(way) == 3  # two bends: before the first and after the last


def test_a_wall_across_the_floor_leaves_no_way():
    world = world_of([Box.wall((4.0, 0.0), (4.0, 6.0))], places={"beyond": (6.0, 3.0)})
    assert world.path((1.0, 1.0), (6.0, 3.0)) is None
    with pytest.raises(TargetError) as caught:
        world.way((1.0, 1.0), "beyond")
    assert str(caught.value) == (
        "no way leads from 1,1 to 'beyond': walls are in between, or a gap is too narrow for "
        "the robot"
    )


@pytest.mark.parametrize(("gap", "passes"), [(0.49, False), (0.5, True), (0.6, True)])
def test_a_robot_passes_a_gap_as_wide_as_itself_and_none_narrower(gap, passes):
    lower, upper = Box.wall((4, 0), (4, 3)), Box.wall((4, 3 + gap), (4, 6))
    assert (world_of([lower, upper]).path((1.0, 1.0), (6.0, 3.0)) is not None) == passes


def seen_by_marching(boxes, origin, angle, max_range, step=0.005):
    """Walk along the ray until something is there."""
    for k in range(int(max_range / step) + 1):
        x, y = origin[0] + k * step * math.cos(angle), origin[1] + k * step * math.sin(angle)
        if not (0 <= x <= SIZE[0] and 0 <= y <= SIZE[1]):
            return k * step
        if any(min(depths(box, (x, y))) > 0 for box in boxes):
            return k * step
    return max_range


@settings(max_examples=examples(40))
@given(st.lists(rectangles, max_size=4), points, st.floats(-3, 3), st.floats(1.0, 12.0))
def test_scan_agrees_with_stepping_along_each_ray(boxes, origin, theta, max_range):
    world = world_of(boxes)
    assume(world.is_free(origin))
    angles = [k * math.tau / 12 for k in range(12)]
    ranges = world.cast(Pose(*origin, theta), angles, max_range)
    for angle, measured in zip(angles, ranges, strict=True):
        walked = seen_by_marching(boxes, origin, theta + angle, max_range)
        # A ray that only grazes a corner passes between two steps of the walk.
        assert measured <= walked + 1e-6
        x = origin[0] + measured * math.cos(theta + angle)
        y = origin[1] + measured * math.sin(theta + angle)
        edges = [abs(x), abs(y), abs(x - SIZE[0]), abs(y - SIZE[1]), max_range - measured]
        touches = [abs(min(depths(box, (x, y)))) for box in boxes]
        assert min(edges + touches) < 1e-6


def test_ranges_of_a_thin_wall_can_be_done_in_the_head():
    world = world_of([Box.wall((4.0, 0.0), (4.0, 2.0))])
    ranges = world.cast(Pose(1.0, 1.0, 0.0), [0.0, math.pi / 2, math.pi, -math.pi / 2], 10.0)
    assert ranges == pytest.approx([3.0, 5.0, 1.0, 1.0])
    assert world.cast(Pose(1.0, 3.0, 0.0), [0.0], 10.0) == pytest.approx([7.0])
    assert world.cast(Pose(1.0, 3.0, 0.0), [0.0], 5.0) == [5.0]


def test_a_scan_is_relative_to_the_robots_heading():
    world = world_of([])
    ahead = world.cast(Pose(1.0, 2.0, math.pi / 2), [0.0], 10.0)
    assert ahead == pytest.approx([4.0])


WORLD = World(
    (8.0, 6.0),
    dock=(1.0, 1.0),
    obstacles=[Box.rectangle((4.0, 2.0), (1.0, 1.0))],
    places={"warehouse": (6.0, 5.0), "station_1": (6.0, 1.0)},
)


@pytest.mark.parametrize(
    ("target", "point"),
    [
        ("warehouse", (6.0, 5.0)),
        (" dock ", (1.0, 1.0)),
        ("3,4", (3.0, 4.0)),
        ("3 4", (3.0, 4.0)),
        ("  3.5 , .5 ", (3.5, 0.5)),
        ("1e0,+2.", (1.0, 2.0)),
        ("0.25,0.25", (0.25, 0.25)),
    ],
)
def test_a_target_is_a_place_or_two_numbers(target, point):
    assert WORLD.resolve(target) == point


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (
            "warehose",
            "unknown target 'warehose' (did you mean 'warehouse'?): expected a place "
            "(dock, station_1, warehouse) or x,y in metres",
        ),
        (
            "Warehouse",
            "unknown target 'Warehouse' (did you mean 'warehouse'?): expected a place "
            "(dock, station_1, warehouse) or x,y in metres",
        ),
        (
            "moon",
            "unknown target 'moon': expected a place (dock, station_1, warehouse) or x,y in metres",
        ),
        (
            "",
            "the target is empty: expected a place (dock, station_1, warehouse) or x,y in metres",
        ),
        (
            "9,1",
            "target '9,1' is outside the map: x goes from 0 to 8, y from 0 to 6 metres",
        ),
        (
            "4.5,2.5",
            "the robot cannot stand at '4.5,2.5': a wall or obstacle is nearer than its radius "
            "of 0.25 metres",
        ),
        (
            "0.1,3",
            "the robot cannot stand at '0.1,3': a wall or obstacle is nearer than its radius "
            "of 0.25 metres",
        ),
    ],
)
def test_error_of_a_wrong_target_names_the_allowed_targets(target, message):
    with pytest.raises(TargetError) as caught:
        WORLD.resolve(target)
    assert str(caught.value) == message


@given(st.text(max_size=12))
def test_any_text_is_a_target_or_a_target_error(text):
    try:
        point = WORLD.resolve(text)
    except TargetError:
        return
    assert WORLD.is_free(point)


@pytest.mark.parametrize(
    "target", ["nan,1", "inf,1", "1;2", "1,2,3", "1", "٣,1", "1_0,1", "1e999,1"]
)
def test_texts_that_resemble_numbers_are_refused(target):
    with pytest.raises(TargetError):
        WORLD.resolve(target)
