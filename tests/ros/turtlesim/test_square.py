"""The driver of draw_square, together with the simulated turtle."""

import pytest

from taskrpc.ros.turtlesim.square import SquareDriver, is_moving
from taskrpc.ros.turtlesim.world import CENTRE, STEP, World


def test_the_driver_draws_a_square_and_returns_to_its_start():
    world = World()
    turtle = world.spawn("turtle1", CENTRE, CENTRE, 0.0)
    driver, corners, log = SquareDriver(), [], []
    for number in range(5000):
        moves = is_moving(turtle.speed, turtle.angular)
        command = driver.command((turtle.x, turtle.y, turtle.theta), moves)
        if command.log[:1] == ["Reached goal"]:
            corners.append((turtle.x, turtle.y))
        log += command.log
        turtle.command(command.linear, 0.0, command.angular, number * STEP)
        world.step(number * STEP)
        if len(corners) == 8:
            break
    offsets = [(x - CENTRE, y - CENTRE) for x, y in corners[::2]]
    expected = [(2, 0), (2, 2), (0, 2), (0, 0)]
    for offset, corner in zip(offsets, expected, strict=True):
        assert offset == pytest.approx(corner, abs=0.4)
    assert log[:3] == [
        "New goal [7.544445 5.544445, 0.000000]",
        "Reached goal",
        log[2],
    ]
    assert log[2].endswith(", 1.570796]")
