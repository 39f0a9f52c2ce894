"""The physics of turtlesim."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from taskrpc.ros.turtlesim.canvas import EMPTY, Pen
from taskrpc.ros.turtlesim.world import CENTRE, SIDE, STEP, World, normalized, pixel

SPEEDS = st.floats(-50, 50)
PLACES = st.floats(0, SIDE)
ANGLES = st.floats(-20, 20)


def a_turtle(x=CENTRE, y=CENTRE, theta=0.0):
    world = World()
    return world, world.spawn("turtle1", x, y, theta)


def steps(world, count, start=0.0):
    moves = [world.step(start + number * STEP)["turtle1"] for number in range(count)]
    return moves[-1]


def test_a_command_moves_a_turtle_for_one_second():
    world, turtle = a_turtle()
    turtle.command(2.0, 0.0, 0.0, now=0.0)
    steps(world, 200)
    assert turtle.x == pytest.approx(CENTRE + 2.0, abs=2 * STEP)
    assert turtle.y == CENTRE
    assert turtle.speed == 0.0


def test_a_turtle_drives_the_circle_of_the_tutorial():
    world, turtle = a_turtle()
    for number in range(round(2 * math.pi / 1.8 / STEP)):
        turtle.command(2.0, 0.0, 1.8, now=number * STEP)
        world.step(number * STEP)
        distance = math.hypot(turtle.x - CENTRE, turtle.y - CENTRE - 2.0 / 1.8)
        assert distance == pytest.approx(2.0 / 1.8, abs=0.03)
    assert (turtle.x, turtle.y) == pytest.approx((CENTRE, CENTRE), abs=0.05)


def test_a_sideways_speed_is_to_the_left_of_the_heading():
    world, turtle = a_turtle(theta=math.pi / 2)
    turtle.command(0.0, 1.0, 0.0, now=0.0)
    steps(world, 10)
    assert (turtle.x, turtle.y) == pytest.approx((CENTRE - 10 * STEP, CENTRE))


def test_a_wall_stops_a_turtle_and_is_reported_from_the_upper_left_corner():
    world, turtle = a_turtle(x=SIDE, y=1.0)
    turtle.command(1.0, 0.0, 0.0, now=0.0)
    moved = steps(world, 1)
    assert moved.hit == pytest.approx((SIDE + STEP, SIDE - 1.0))
    assert (turtle.x, turtle.y) == (SIDE, 1.0)


@given(PLACES, PLACES, ANGLES, st.lists(st.tuples(SPEEDS, SPEEDS, SPEEDS), max_size=20))
def test_a_turtle_never_leaves_the_window(x, y, theta, commands):
    world, turtle = a_turtle(x, y, theta)
    for number, command in enumerate(commands):
        turtle.command(*command, now=number * STEP)
        moved = world.step(number * STEP)["turtle1"]
        assert 0 <= turtle.x <= SIDE
        assert 0 <= turtle.y <= SIDE
        assert -math.pi <= turtle.theta <= math.pi
        if moved.hit is not None:
            assert turtle.x in (0, SIDE) or turtle.y in (0, SIDE)


@given(ANGLES)
def test_normalized_is_the_same_direction_between_minus_pi_and_pi(angle):
    result = normalized(angle)
    assert -math.pi <= result <= math.pi
    assert math.cos(result - angle) == pytest.approx(1.0)


def test_teleports_draw_a_line_and_happen_in_their_order():
    world, turtle = a_turtle()
    turtle.teleport_absolute(2.0, 3.0, math.pi / 2)
    turtle.teleport_relative(1.0, -math.pi / 2)
    steps(world, 1)
    assert (turtle.x, turtle.y, turtle.theta) == pytest.approx((3.0, 3.0, 0.0))
    for x in (2.0, 2.5, 3.0):
        assert world.canvas.color_at(pixel(x, 3.0)) == Pen().color
    assert turtle.color == Pen().color


def test_a_teleport_out_of_the_window_hits_the_wall():
    world, turtle = a_turtle()
    turtle.teleport_absolute(20.0, 20.0, 0.0)
    moved = steps(world, 1)
    assert moved.hit == pytest.approx((20.0, 0.0))
    assert (turtle.x, turtle.y) == (SIDE, SIDE)


def test_a_turtle_with_its_pen_up_draws_nothing_and_senses_empty_paper():
    world, turtle = a_turtle()
    turtle.set_pen((1, 2, 3), 5, off=True)
    turtle.command(1.0, 0.0, 0.0, now=0.0)
    steps(world, 20)
    assert (world.canvas.pixels(), turtle.color) == ({}, EMPTY)
    turtle.set_pen((1, 2, 3), 0, off=False)
    steps(world, 2, start=20 * STEP)
    assert turtle.pen == Pen((1, 2, 3), 1)
    assert turtle.color == (1, 2, 3)


@given(ANGLES, ANGLES)
def test_a_rotation_reaches_its_heading_the_short_way(theta, goal):
    world, turtle = a_turtle(theta=normalized(theta))
    turtle.rotate_to(goal)
    lefts = []
    for number in range(250):
        rotation = world.step(number * STEP)["turtle1"].rotation
        lefts.append(abs(rotation.remaining))
        if rotation.done:
            break
    assert rotation.done
    assert lefts == sorted(lefts, reverse=True)
    assert math.cos(turtle.theta - goal) > math.cos(0.021)
    assert (turtle.angular, turtle.speed) == (0.0, 0.0)
    assert world.step(9.0)["turtle1"].rotation is None


def test_a_new_rotation_replaces_an_earlier_one_and_a_stopped_turtle_stays():
    world, turtle = a_turtle()
    turtle.rotate_to(3.0)
    steps(world, 10)
    turtle.rotate_to(0.0)
    assert steps(world, 1, start=1.0).rotation.remaining < 0
    turtle.stop_rotation()
    assert steps(world, 1, start=1.1).rotation is None
    assert turtle.angular == 0.0


def test_names_count_up_and_skip_names_that_are_taken():
    world = World()
    world.spawn("turtle2", 1.0, 1.0, 0.0)
    assert [world.spawn(world.free_name(), 1, 1, 0).name for _ in range(2)] == [
        "turtle1",
        "turtle3",
    ]
    world.reset()
    assert (world.turtles, world.free_name()) == ({}, "turtle1")


def test_the_same_commands_draw_the_same_picture():
    pictures = []
    for _ in range(2):
        world, turtle = a_turtle()
        turtle.command(2.0, 0.0, 1.8, now=0.0)
        steps(world, 100)
        pictures.append(world.canvas.pixels())
    assert pictures[0] == pictures[1]
    assert len(pictures[0]) > 100


ANY = st.floats(width=32)


@given(ANY, ANY, ANY)
def test_any_numbers_leave_a_turtle_inside_the_window(x, y, theta):
    world, turtle = a_turtle(x, y, theta)
    turtle.teleport_absolute(y, x, theta)
    turtle.teleport_relative(x, theta)
    turtle.command(x, y, theta, now=0.0)
    world.step(0.0)
    turtle.rotate_to(theta)
    world.step(STEP)
    assert 0 <= turtle.x <= SIDE
    assert 0 <= turtle.y <= SIDE
    assert -math.pi <= turtle.theta <= math.pi


@given(st.floats(), st.floats(), st.floats())
def test_any_velocity_gives_a_pose_that_fits_a_message(linear_x, linear_y, angular):
    world, turtle = a_turtle()
    turtle.command(linear_x, linear_y, angular, now=0.0)
    world.step(0.0)
    pose = turtle.x, turtle.y, turtle.theta, turtle.speed, turtle.angular
    largest_float32 = 3.4e38
    assert all(abs(value) < largest_float32 for value in pose)
