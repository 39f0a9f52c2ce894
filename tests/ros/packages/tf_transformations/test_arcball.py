"""The virtual trackball. The numbers are those of the original's documentation."""

import numpy as np
import pytest

from taskrpc.ros.packages.tf_transformations import Arcball


def test_drag_turns_the_ball():
    ball = Arcball(initial=np.identity(4))
    ball.place([320, 320], 320)
    ball.down([500, 250])
    ball.drag([475, 275])
    assert np.sum(ball.matrix()) == pytest.approx(3.90583455)
    ball.drag([475, 275])
    assert np.sum(ball.matrix()) == pytest.approx(3.90583455)


def test_constrained_ball_turns_about_an_axis():
    ball = Arcball(initial=[0, 0, 0, 1])
    ball.place([320, 320], 320)
    ball.setaxes([1, 1, 0], [-1, 1, 0])
    ball.setconstrain(True)
    assert ball.getconstrain()
    ball.down([400, 200])
    ball.drag([200, 400])
    assert np.sum(ball.matrix()) == pytest.approx(0.2055924)
    ball.next()
    assert np.linalg.det(ball.matrix()) == pytest.approx(1)


def test_first_rotation_must_be_a_quaternion_or_matrix():
    with pytest.raises(ValueError, match="initial not a quaternion or matrix"):
        Arcball([1, 2])
