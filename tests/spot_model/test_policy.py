from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from spot_model.policy.contract import METADATA_KEY, PolicyContract, PolicyError, StoredPair
from spot_model.policy.policy import load_policy, policy_from_bytes
from spot_model.robot import facts
from spot_model.robot.state import RobotState

onnx = pytest.importorskip("onnx")
from onnx import TensorProto, helper, numpy_helper  # noqa: E402

ISAAC_LAB = tuple(f"{leg}_{joint}" for joint in facts.JOINT_TYPES for leg in facts.LEG_NAMES)
"""Isaac Lab's order of the joints."""


def network(*, inputs: int = 48, outputs: int = 12, batch: object = "batch", seed: int = 0):
    rng = np.random.default_rng(seed)
    weight = rng.normal(0.0, 0.1, (inputs, outputs)).astype(np.float32)
    graph = helper.make_graph(
        [helper.make_node("MatMul", ["observation", "weight"], ["action"])],
        "policy",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, [batch, inputs])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, [batch, outputs])],
        [numpy_helper.from_array(weight, "weight")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    return model, weight


def contract(weight: np.ndarray, **changes: object) -> PolicyContract:
    observation = np.linspace(-1.0, 1.0, 48)
    action = observation.astype(np.float32) @ weight
    data: dict = {
        "name": "test",
        "velocity_command_low": (-1.0, -0.5, -1.0),
        "velocity_command_high": (1.5, 0.5, 1.0),
        "stored_pair": StoredPair(observation=tuple(observation), action=tuple(float(a) for a in action)),
    }
    return PolicyContract(**{**data, **changes})


def onnx_bytes(model, contract_json: str | None) -> bytes:
    if contract_json is not None:
        entry = model.metadata_props.add()
        entry.key, entry.value = METADATA_KEY, contract_json
    return model.SerializeToString()


def state(position_rad: np.ndarray) -> RobotState:
    zeros3 = np.zeros(3)
    return RobotState(
        robot_stamp_ns=0,
        host_stamp_ns=0,
        position_rad=position_rad,
        velocity_rad_s=np.arange(12) * 0.1,
        load_nm=np.zeros(12),
        position_of_body_in_odom_m=zeros3,
        odom_from_body_wxyz=np.array([1.0, 0.0, 0.0, 0.0]),
        linear_vel_of_body_in_odom_m_s=zeros3,
        angular_vel_of_body_in_odom_rad_s=zeros3,
        foot_contact=np.ones(4, dtype=bool),
        last_command_key=0,
        last_command_robot_stamp_ns=0,
    )


def test_a_contract_survives_the_file_at_full_precision():
    model, weight = network()
    pi = contract(weight, default_position_rad=tuple(np.nextafter(facts.DEFAULT_POSITION_RAD, 9.0)))
    policy = policy_from_bytes(onnx_bytes(model, pi.to_json()), source="p")
    assert policy.contract == pi


def test_single_and_batch_agree():
    model, weight = network()
    policy = policy_from_bytes(onnx_bytes(model, contract(weight).to_json()), source="p")
    batch = np.random.default_rng(1).normal(size=(5, 48))
    np.testing.assert_allclose(policy.act(batch)[3], policy.act(batch[3]), rtol=1e-5)
    assert policy.act(batch[0]).shape == (12,)


def test_one_observation_at_a_time_gives_the_bits_of_a_run_with_new_arrays():
    model, weight = network()
    policy = policy_from_bytes(onnx_bytes(model, contract(weight).to_json()), source="p")
    rows = np.random.default_rng(1).normal(size=(5, 48)).astype(np.float32)
    actions = [policy.act(row) for row in rows]  # kept: no later run may change an earlier result
    for row, action in zip(rows, actions, strict=True):
        np.testing.assert_array_equal(action, policy.session.run(None, {"observation": row[np.newaxis]})[0][0])


def test_another_joint_order_is_undone_on_both_sides():
    model, weight = network()
    isaac = [facts.JOINT_NAMES.index(n) for n in ISAAC_LAB]
    policy = policy_from_bytes(
        onnx_bytes(
            model,
            contract(
                weight,
                joint_names=ISAAC_LAB,
                default_position_rad=tuple(facts.DEFAULT_POSITION_RAD[isaac]),
                kp_nm_per_rad=tuple(np.arange(1.0, 13.0)[isaac]),
            ).to_json(),
        ),
        source="p",
    )
    observation = policy.observe(
        state(facts.DEFAULT_POSITION_RAD + np.arange(12)), np.zeros(3), np.zeros(12, np.float32)
    )
    np.testing.assert_allclose(observation[12:24], isaac, atol=1e-12)
    action = np.array([float(i) for i in isaac])
    np.testing.assert_allclose(policy.setpoint_rad(action), facts.DEFAULT_POSITION_RAD + 0.2 * np.arange(12))
    np.testing.assert_array_equal(policy.gains().kp_nm_per_rad, np.arange(1.0, 13.0))
    actions = np.random.default_rng(1).normal(size=(20, 12)).astype(np.float32)  # one by one as all at once
    np.testing.assert_array_equal([policy.setpoint_rad(a) for a in actions], policy.setpoint_rad(actions))


def test_what_does_not_hold_is_refused_with_what_was_expected(tmp_path: Path):
    _, weight = network()
    good = contract(weight).to_json()

    def refused(data: bytes, message: str) -> None:
        with pytest.raises(PolicyError, match=message):
            policy_from_bytes(data, source="p")

    refused(b"not a model", "is no readable ONNX model")
    data = onnx_bytes(network()[0], good)
    refused(data[: len(data) // 2], "is no readable ONNX model")
    refused(onnx_bytes(network()[0], None), "has no contract")
    refused(
        onnx_bytes(network(inputs=47)[0], good),
        r"input is .*47.*expected one float tensor 'observation' of shape \(batch, 48\)",
    )
    refused(onnx_bytes(network(outputs=11)[0], good), r"output is .*expected .*'action' of shape \(batch, 12\)")
    refused(onnx_bytes(network(batch=4)[0], good), "input is")
    refused(onnx_bytes(network(seed=5)[0], good), "the stored input gives an action that is off by")

    def changed(**values: object) -> bytes:
        return onnx_bytes(network()[0], json.dumps({**json.loads(good), **values}))

    refused(changed(joint_names=["fl_hx"] * 12), "joint_names.*must name each of fl_hx")
    refused(changed(rate_hz=5000), "rate_hz = 5000")
    refused(changed(kp_nm_per_rad=[60.0] * 11), "kp_nm_per_rad has 11 values; 12 are needed")
    for kp in (-60.0, 0.0, 7500.0):
        refused(changed(kp_nm_per_rad=[60.0, kp] * 6), f"kp_nm_per_rad of fl_hy is {kp:g}; allowed: above 0")
    refused(changed(kd_nm_s_per_rad=[1.5] * 11 + [51.0]), "kd_nm_s_per_rad of hr_kn is 51; allowed: 0 to 50")
    refused(
        changed(default_position_rad=[0.0, 51.6, -1.5] * 4), r"of fl_hy is 51.6; allowed: .* \(radians, not degrees"
    )
    refused(changed(schema="spot-rl/policy/9"), "schema = 'spot-rl/policy/9'")
    refused(changed(extra=1), "extra = 1")
    refused(changed(velocity_command_low=[2, 0, 0]), "must not exceed")
    with pytest.raises(PolicyError, match="cannot be read: No such file"):
        load_policy(tmp_path / "none.onnx")
