"""The configuration of one run: strict models over YAML, every bound a key, the whole of it in the log's header."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AliasChoices, Field, ValidationError, field_validator

from spot_model.errors import BadInputError
from spot_model.io.settings import Settings, between, explain, positive
from spot_model.io.yaml_text import read_yaml
from spot_runtime.safety_limits import SafetyLimits


class ServiceConfig(Settings):
    """Operator's service (``spot-rl serve``): access, rates, and reactions when no operator is present."""

    listen: str = Field(
        default="",
        description="'unix:/path', or HOST:PORT; empty: operator.sock in the service's or the user's run-time folder. "
        "A host that is not loopback needs the three tls_ files.",
    )
    tls_certificate: Path | None = Field(default=None, description="PEM file: the service's certificate.")
    tls_key: Path | None = Field(default=None, description="PEM file: its key, readable by its owner alone.")
    tls_client_ca: Path | None = Field(default=None, description="PEM file: who signs the operators' certificates.")
    policies: Path | None = Field(
        default=None,
        description="Folder whose .onnx files may be armed, by name; null: ./policies, or else the built-in ones.",
    )
    policy_sha256: tuple[str, ...] = Field(
        default=(), max_length=1000, description="If given, only policies with one of these digests may be armed."
    )
    policy_public_key: Path | None = Field(
        default=None,
        description="PEM file of Ed25519 public keys: if given, only policies that one of them has signed may run.",
    )
    deadman_s: float = positive(0.25, 2.0, "Silence of the steering operator after which the velocity fades to zero.")
    attendance_s: float = between(
        10.0, 1.0, 600.0, "Silence of all operators after which the robot stops, sits and powers off."
    )
    arm_timeout_s: float = between(90.0, 5.0, 600.0, "Longest time from arming to standing, and from the end to rest.")
    requests_per_s: float = between(50.0, 1.0, 1000.0, "Calls that each client may make, steering apart.")
    steering_per_s: float = between(100.0, 10.0, 1000.0, "SetVelocity calls of each client.")
    live_port: int = between(0, 0, 65535, "TCP port of the live view for Foxglove, on loopback; 0: none.")

    @field_validator("policy_sha256")
    @classmethod
    def _are_digests(cls, digests: tuple[str, ...]) -> tuple[str, ...]:
        for digest in digests:
            if len(digest) != 64 or set(digest) - set("0123456789abcdef"):
                raise ValueError(f"{digest!r} is no SHA-256 in 64 small hexadecimal digits")
        return digests


class RobotConfig(Settings):
    """Connection to the robot. Passwords are not part of it; they come from a file or the environment."""

    hal: str = Field(
        default="spot",
        min_length=1,
        max_length=200,
        description="Adapter: 'spot', the name of an installed one, or module:function.",
    )
    ca_file: Path | None = Field(default=None, description="PEM file to trust in addition to the vendor's certificate.")
    credentials_file: Path | None = Field(
        default=None, description="YAML file with 'username' and 'password', readable by its owner alone."
    )
    client_name: str = Field(default="spot-rl", min_length=1, max_length=40)
    estop: Literal["auto", "own", "external"] = Field(
        default="auto",
        description="'external' relies on an existing endpoint, 'own' replaces it, 'auto' makes one only "
        "where no endpoint answers.",
    )
    estop_timeout_s: float = between(9.0, 1.0, 60.0)
    rpc_timeout_s: float = positive(3.0, 30.0)
    power_timeout_s: float = positive(20.0, 120.0)
    stand_timeout_s: float = positive(10.0, 60.0)
    slow_state_rate_hz: float = positive(5.0, 20.0)
    lease_period_s: float = between(
        0.06, 0.02, 4.0, "Period of keeping the lease, and so the delay until a lost lease is noticed."
    )
    time_sync_period_s: float = between(2.0, 0.1, 60.0)


class ControlConfig(Settings):
    """What every command carries."""

    end_time_ahead_s: float = between(
        0.05, 0.02, 0.1, "A command expires this long after it was sent, by the robot's clock."
    )
    velocity_safety_limit_rad_s: float = positive(40.0, 100.0, "Joint speed above which the robot itself stops.")
    resend_on_state: bool = Field(
        default=True, description="Send the current set-points again, with a new end time, on each state message."
    )
    inference: Literal["cpu", "cuda", "tensorrt"] = Field(
        default="cpu",
        description="Provider with which ONNX Runtime computes the policy; refused if it is not available.",
    )
    warm_up: bool = Field(
        default=True,
        validation_alias=AliasChoices("warm_up", "rehearse"),
        description="Compute a dummy step shortly before the state of a tick to warm caches, then wait without "
        "sleeping. Formerly ``rehearse``, which is still read.",
    )


class HandoverConfig(Settings):
    """From the vendor's stand to the policy, and back."""

    settle_s: float = between(0.3, 0.3, 10.0, "Time before the take-over, to average loads and check signals.")
    activation_timeout_s: float = positive(3.0, 30.0)
    ramp_in_s: float = between(2.0, 0.1, 20.0)
    ramp_out_s: float = between(1.0, 0.1, 20.0)
    soft_stop_s: float = between(1.0, 0.0, 10.0, "Time in which the velocity command fades.")
    soft_stop_settle_s: float = between(0.6, 0.0, 10.0, "Standing time after it.")
    damping_s: float = between(1.5, 0.1, 10.0)
    damping_kd_nm_s_per_rad: float = positive(8.0, 50.0)
    urgent_share: float = between(
        0.5, 0.1, 1.0, "Factor on the times of the way back if battery or motors require haste."
    )

    def hastened(self) -> HandoverConfig:
        """The same with a way back that takes only :attr:`urgent_share` of the time."""
        names = ("ramp_out_s", "soft_stop_s", "soft_stop_settle_s")
        return self.model_copy(update={name: getattr(self, name) * self.urgent_share for name in names})


class OperatorConfig(Settings):
    """Keyboard and gamepad."""

    top_v_x_m_s: float = positive(1.0, 5.0)
    top_v_y_m_s: float = positive(0.5, 5.0)
    top_yaw_rate_rad_s: float = positive(1.0, 5.0)
    acceleration_m_s2: float = positive(2.0, 20.0, "Rise of the command; rad/s² for turns.")
    release_s: float = positive(0.25, 2.0, "Time in which a released command fades to zero.")
    keyboard_silence_s: float = positive(0.6, 5.0, "Dead-man: no key for this long counts as released.")
    gamepad_index: int = between(0, 0, 15)
    gamepad_deadman_button: int = between(4, 0, 31)
    gamepad_axis_v_x: int = between(1, 0, 15)
    gamepad_axis_v_y: int = between(0, 0, 15)
    gamepad_axis_yaw: int = between(3, 0, 15)
    gamepad_dead_zone: float = Field(default=0.1, ge=0.0, lt=1.0)


class RealTimeConfig(Settings):
    """Requests to the operating system; refusals are logged once, with the permission to grant."""

    fifo_priority: int = between(40, 0, 98, "SCHED_FIFO for the whole process; 0 asks for none.")
    lock_memory: bool = True
    cpu_affinity: tuple[Annotated[int, Field(ge=0, le=4095)], ...] = Field(
        default=(), description="CPUs to stay on; empty: all."
    )
    watch_processor: bool = Field(
        default=True, description="Watch how long threads wait for a processor, which tells why a state is old."
    )
    freeze_garbage_collection: bool = True
    switch_interval_s: float = between(0.0005, 0.0001, 0.01)


class LogConfig(Settings):
    """Folder of the logs."""

    directory: Path = Path("logs")
    labels: dict[str, str] = Field(default_factory=dict)
    stop_on_failure: bool = Field(default=False, description="End the run when the log no longer records.")


class RunConfig(Settings):
    """Everything that decides how a run goes."""

    schema_name: Literal["spot-rl/run/1"] = Field(default="spot-rl/run/1", alias="schema")
    robot: RobotConfig = RobotConfig()
    control: ControlConfig = ControlConfig()
    handover: HandoverConfig = HandoverConfig()
    safety: SafetyLimits = SafetyLimits()
    operator: OperatorConfig = OperatorConfig()
    real_time: RealTimeConfig = RealTimeConfig()
    log: LogConfig = LogConfig()
    service: ServiceConfig = ServiceConfig()

    def to_json(self) -> str:
        """The whole configuration as JSON, for the log's header; it holds no secret."""
        return self.model_dump_json(by_alias=True)


def for_lock_step(config: RunConfig) -> RunConfig:
    """The same run where robot time waits for us: nothing is gained by real-time rights or warm caches."""
    off = RealTimeConfig(fifo_priority=0, lock_memory=False, freeze_garbage_collection=False, watch_processor=False)
    control = config.control.model_copy(update={"warm_up": False})
    return config.model_copy(update={"real_time": off, "control": control})


def load_config(path: Path) -> RunConfig:
    """Read a configuration from YAML. Raises BadInputError."""
    content = read_yaml(path, "configuration")
    try:
        # By way of JSON, pydantic's strict mode takes a list for a tuple, but neither "3" nor true for 3.
        return RunConfig.model_validate_json(json.dumps({} if content is None else content, default=str), strict=True)
    except ValidationError as error:
        raise BadInputError(f"configuration {path}:\n{explain(error, RunConfig)}") from error
