from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from spot_model.robot.rotation import (
    conjugate_wxyz,
    matrix_from_wxyz,
    multiply_wxyz,
    projected_gravity,
    rotate_inverse_wxyz,
    rotate_wxyz,
    tilt_rad,
    yaw_rad,
)

_numbers = st.floats(-1.0, 1.0, width=64)
quaternions = (
    arrays(np.float64, 4, elements=_numbers)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
vectors = arrays(np.float64, 3, elements=_numbers)


@given(quaternions, vectors)
def test_rotation_and_its_inverse_cancel(q, v):
    np.testing.assert_allclose(rotate_inverse_wxyz(q, rotate_wxyz(q, v)), v, atol=1e-12)


@given(quaternions, quaternions, vectors)
def test_a_product_rotates_as_its_factors_in_turn(a, b, v):
    np.testing.assert_allclose(rotate_wxyz(multiply_wxyz(a, b), v), rotate_wxyz(a, rotate_wxyz(b, v)), atol=1e-12)


@given(quaternions, vectors)
def test_minus_q_is_the_same_rotation(q, v):
    np.testing.assert_allclose(rotate_wxyz(-q, v), rotate_wxyz(q, v), atol=1e-12)


@given(quaternions)
def test_projected_gravity_is_the_world_s_down_in_the_body(q):
    np.testing.assert_allclose(projected_gravity(q), rotate_inverse_wxyz(q, np.array([0.0, 0.0, -1.0])), atol=1e-12)
    np.testing.assert_allclose(
        rotate_wxyz(conjugate_wxyz(q), np.array([0.0, 0.0, -1.0])), projected_gravity(q), atol=1e-12
    )


def test_angles_worked_out_by_hand():
    half = math.radians(15.0)
    roll = np.array([math.cos(half), math.sin(half), 0.0, 0.0])
    yaw = np.array([math.cos(half), 0.0, 0.0, math.sin(half)])
    assert tilt_rad(roll) == pytest.approx(math.radians(30.0))
    assert yaw_rad(yaw) == pytest.approx(math.radians(30.0))
    # Rolled to the right by 30°, gravity leans towards the body's right (−y).
    np.testing.assert_allclose(projected_gravity(roll), [0.0, -0.5, -math.cos(math.radians(30.0))], atol=1e-12)
    # A quarter turn to the left takes x to y.
    quarter = np.array([math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)])
    np.testing.assert_allclose(rotate_wxyz(quarter, np.array([1.0, 0.0, 0.0])), [0.0, 1.0, 0.0], atol=1e-12)


def test_the_matrix_turns_vectors_as_the_quaternion_does():
    rng = np.random.default_rng(3)
    quaternion = rng.normal(size=(4, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    vector = rng.normal(size=(4, 3))
    matrix = matrix_from_wxyz(quaternion)
    np.testing.assert_allclose(np.einsum("nij,nj->ni", matrix, vector), rotate_wxyz(quaternion, vector), atol=1e-14)
    np.testing.assert_allclose(-matrix[:, 2, :], projected_gravity(quaternion), atol=1e-14)
