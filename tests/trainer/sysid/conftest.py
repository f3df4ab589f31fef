"""A policy without training: an oscillator in ONNX that stamps on the spot, and logs of simulated robots under it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import numpy as np
import onnx
import onnxruntime
import pytest
from onnx import TensorProto, helper, numpy_helper

from spot_log import Run
from spot_model.effects.base import CommandEffect
from spot_model.io.model_file import paper_model
from spot_model.plant.delay import ConstantDelay, Delay
from spot_model.plant.plant import Plant, PlantOptions
from spot_model.policy.contract import METADATA_KEY, PolicyContract, StoredPair
from spot_model.policy.policy import Policy, load_policy
from spot_model.robot import facts
from spot_model.robot.facts import PaperActuator
from spot_model.robot.mjcf import MjcfOptions, default_height_m
from trainer.simulate.recorded_loop import Course, RecordedLoop, SensorNoise

OTHER_PHYSICS = MjcfOptions(
    timestep_s=0.0015,
    integrator="implicitfast",
    cone="elliptic",
    contact_solref=(0.012, 1.1),
    collision="feet",
    link_torque_sensors=True,
)
"""Step, integrator, cone and contact that the search's plant does not have."""

DELAY = ConstantDelay(delay_s=facts.TRAINING_COMMAND_DELAY_S)
USUAL_NOISE = SensorNoise(3e-4, 0.03, 0.4)
MakeLogs = Callable[..., list[Run]]


def oscillator_bytes(swing: float = 1.0, lift: float = 3.0, rate_hz: float = 3.5, name: str = "stamp") -> bytes:
    """A two-state oscillator whose state is the last action; legs in trot order."""
    pattern = np.zeros((12, 2))
    for leg, phase in enumerate((0.0, np.pi, np.pi, 0.0)):
        pattern[3 * leg + 1] = swing * np.array([np.cos(phase), np.sin(phase)])
        pattern[3 * leg + 2] = lift * np.array([np.cos(phase + np.pi / 2), np.sin(phase + np.pi / 2)])
    turn = 2.0 * np.pi * rate_hz / 50.0
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    first, bias = np.zeros((4, 48)), np.array([0.05, 0.0, 0.0, 0.0])
    first[:2, 36:] = 1.3 * rotation @ np.linalg.pinv(pattern)
    first[2, 9], first[3, 10] = 0.3, 0.3
    second = np.zeros((12, 4))
    second[:, :2] = pattern
    second[1::3, 2], second[0::3, 3] = -0.5, 0.5
    arrays = {"first": first, "bias": bias, "second": second, "none": np.zeros(12)}
    graph = helper.make_graph(
        [
            helper.make_node("Gemm", ["observation", "first", "bias"], ["hidden"], transB=1),
            helper.make_node("Tanh", ["hidden"], ["bounded"]),
            helper.make_node("Gemm", ["bounded", "second", "none"], ["action"], transB=1),
        ],
        "oscillator",
        [helper.make_tensor_value_info("observation", TensorProto.FLOAT, ["batch", 48])],
        [helper.make_tensor_value_info("action", TensorProto.FLOAT, ["batch", 12])],
        [numpy_helper.from_array(a.astype(np.float32), key) for key, a in arrays.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    seen = np.linspace(-1.0, 1.0, 48).astype(np.float32)
    done = onnxruntime.InferenceSession(model.SerializeToString()).run(None, {"observation": seen[None]})[0][0]
    contract = PolicyContract(
        name=name,
        velocity_command_low=(-2.0, -1.0, -1.0),
        velocity_command_high=(4.0, 1.0, 1.0),
        stored_pair=StoredPair(observation=tuple(map(float, seen)), action=tuple(map(float, done))),
    )
    entry = model.metadata_props.add()
    entry.key, entry.value = METADATA_KEY, contract.to_json()
    onnx.checker.check_model(model)
    return bytes(model.SerializeToString())


@pytest.fixture(scope="session")
def policy_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("policy") / "stamp.onnx"
    path.write_bytes(oscillator_bytes())
    return path


@pytest.fixture(scope="session")
def policy(policy_path: Path) -> Policy:
    return load_policy(policy_path)


@dataclass(frozen=True, kw_only=True)
class DrawnDelay(CommandEffect):
    """Each command is as late as a distribution says."""

    name: ClassVar[str] = "drawn_delay"

    delay: Delay

    def arrival_s(self, issued_s: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return issued_s + self.delay.sample(rng, len(issued_s))


@pytest.fixture(scope="session")
def make_logs(policy: Policy) -> MakeLogs:
    """Logs of a robot with a given truth: ``make_logs(actuator, sequences={"a": 0.0}, n_ticks, n_repeats, ...)``.

    ``sequences`` has a forward speed by name; repeats differ by noise, delays and a slightly different start. ``delay``
    is from a state's stamp to the receipt of the command that answers it.
    """

    def make(
        truth: PaperActuator,
        *,
        sequences: dict[str, float],
        n_ticks: int,
        n_repeats: int,
        noise: SensorNoise = USUAL_NOISE,
        seed: int = 0,
        with_policy: Policy | None = None,
        delay: Delay = DELAY,
        mjcf: MjcfOptions = OTHER_PHYSICS,
    ) -> list[Run]:
        rng = np.random.default_rng(seed)
        effects = [e for e in paper_model(truth).effects if not isinstance(e, CommandEffect)]
        runs: list[Run] = []
        for name, v_x_m_s in sequences.items():
            plant = Plant(effects, n_repeats, PlantOptions(mjcf=mjcf, n_threads=1))
            pose = facts.DEFAULT_POSITION_RAD + 0.02 * rng.standard_normal((n_repeats, facts.N_JOINTS))
            plant.reset(joint_position_rad=pose, position_of_body_in_world_m=(0.0, 0.0, default_height_m() + 0.01))
            command = np.tile([v_x_m_s, 0.0, 0.0], (n_ticks, 1))
            runs += RecordedLoop(
                plant,
                with_policy or policy,
                [Course(name, i, command) for i in range(n_repeats)],
                start_setpoint_rad=pose,
                last_action=np.zeros((n_repeats, facts.N_JOINTS), dtype=np.float32),
                channel=[DrawnDelay(delay=delay)],
                rng=rng,
                noise=noise,
            ).runs()
        return runs

    return make


@pytest.fixture(scope="session")
def strong_truth() -> PaperActuator:
    """Limits that the stamping robot reaches."""
    return PaperActuator(0.1, 0.4, 45.0, -40.0, 12.0, -12.0, 4.0, -4.0)


@pytest.fixture(scope="session")
def logs(make_logs: MakeLogs, strong_truth: PaperActuator) -> list[Run]:
    """Two sequences of 3 s, three repeats each; nothing in a test may change them."""
    return make_logs(strong_truth, sequences={"a": 0.0, "b": 1.0}, n_ticks=150, n_repeats=3)
