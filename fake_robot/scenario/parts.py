"""The parts of a scenario: physics, channels, sensors, body, power, services, and policies unknown without a robot."""

from __future__ import annotations

from typing import Literal

from pydantic import ConfigDict, Field, model_validator

from spot_model.io.settings import Settings
from spot_model.plant.delay import Delay, LogNormalDelay
from spot_model.robot.arm import ARM_HIGH_RAD, ARM_JOINT_NAMES, ARM_LOW_RAD, STOWED_RAD
from spot_model.robot.facts import JOINT_NAMES, ROBOT_CLOCK_SKEW_S, STATE_PERIOD_NS

JointName = Literal[
    "fl_hx", "fl_hy", "fl_kn", "fr_hx", "fr_hy", "fr_kn", "hl_hx", "hl_hy", "hl_kn", "hr_hx", "hr_hy", "hr_kn"
]
assert set(JointName.__args__) == set(JOINT_NAMES)  # type: ignore[attr-defined]  # noqa: S101


class Part(Settings):
    """A part of a scenario; what stands below a key is its description."""

    model_config = ConfigDict(use_attribute_docstrings=True)


class PhysicsConfig(Part):
    """How the body is simulated.

    Step, integrator, cone and contact differ on purpose from those of the plant. Training, identification and diagnosis
    use the plant, so none of them succeeds merely because it repeats the fake robot's arithmetic.
    """

    substeps_per_state: int = Field(default=2, ge=1, le=12)
    """Physics steps in the 3 ms between two state messages; 2 gives steps of 1.5 ms."""
    integrator: Literal["Euler", "implicitfast", "implicit"] = "implicitfast"
    """MuJoCo's integrator."""
    cone: Literal["pyramidal", "elliptic"] = "elliptic"
    """MuJoCo's friction cone."""
    solver_iterations: int = Field(default=20, ge=1, le=200)
    """Largest number of solver iterations."""
    contact_time_constant_s: float = Field(default=0.012, ge=0.002, le=0.2)
    """MuJoCo's contact time constant."""
    contact_damping_ratio: float = Field(default=1.1, gt=0.0, le=5.0)
    """MuJoCo's contact damping ratio."""
    armature_hip_kg_m2: float = Field(default=0.0403, ge=0.0, le=1.0)
    """Reflected rotor inertia of a hip joint."""
    armature_knee_kg_m2: float = Field(default=0.0731, ge=0.0, le=1.0)
    """Reflected rotor inertia of a knee; both defaults are from one public estimate."""
    unpowered_damping_nm_s_per_rad: float = Field(default=6.0, ge=0.0, le=100.0)
    """Drag of gears and shorted motors without power: the robot sinks to the ground, it does not drop."""

    @property
    def timestep_s(self) -> float:
        """Length of a physics step, s."""
        return STATE_PERIOD_NS / self.substeps_per_state * 1e-9

    @model_validator(mode="after")
    def _step_is_whole(self) -> PhysicsConfig:
        if STATE_PERIOD_NS % self.substeps_per_state:
            raise ValueError("substeps_per_state must divide 3 ms into whole nanoseconds: 1, 2, 3, 4, 5, 6, 8, 10, 12")
        return self


class TerrainConfig(Part):
    """The ground."""

    kind: Literal["flat", "noise"] = "flat"
    """`flat`, or `noise`: rough ground."""
    friction: float = Field(default=0.8, ge=0.0, le=3.0)
    """Friction coefficient."""
    amplitude_m: float = Field(default=0.03, gt=0.0, le=0.3)
    """Largest height of the rough ground."""
    cell_m: float = Field(default=0.25, gt=0.05, le=2.0)
    """Distance between its grid points."""
    half_size_m: float = Field(default=15.0, gt=1.0, le=50.0)
    """Half the side of the square of rough ground, beyond which the ground is flat."""


class PayloadConfig(Part):
    """A mass bolted to the body; 0 kg for none."""

    mass_kg: float = Field(default=0.0, ge=0.0, le=40.0)
    """Its mass."""
    com_in_body_m: tuple[float, float, float] = (0.0, 0.0, 0.12)
    """Its centre of mass in the body frame: forward, left, up."""


class ArmConfig(Part):
    """The arm of a robot with ``model: {robot: spot_with_arm}``; without meaning for others."""

    position_rad: tuple[float, float, float, float, float, float, float] = tuple(STOWED_RAD.tolist())
    """Where its joints are at the start: sh0, sh1, el0, el1, wr0, wr1, f1x; stowed by default."""

    @model_validator(mode="after")
    def _is_within_stops(self) -> ArmConfig:
        for name, at, low, high in zip(ARM_JOINT_NAMES, self.position_rad, ARM_LOW_RAD, ARM_HIGH_RAD, strict=True):
            if not low <= at <= high:
                raise ValueError(f"position_rad of {name} = {at:g}; allowed: {low:g} to {high:g}")
        return self


class ChannelConfig(Part):
    """One direction of the network between client and robot, in robot time. Whole messages, in order."""

    delay: Delay
    """Its distribution, one of [the kinds below](#delays)."""
    drop_probability: float = Field(default=0.0, ge=0.0, le=1.0)
    """Probability that a message is lost."""


STATE_CHANNEL = ChannelConfig(delay=LogNormalDelay(floor_s=0.0009, median_s=0.0006, sigma=0.26))
"""From the acquisition of a state to the client. The floor is the 0.90 ms between the joints' stamp and the header's in
a published recording; with the command channel, state to command received is 4.5 ms in the median, and its 99th
percentile 1 ms above it, the spread of the state age in that recording."""

COMMAND_CHANNEL = ChannelConfig(delay=LogNormalDelay(floor_s=0.0016, median_s=0.0014, sigma=0.2))
"""From the client to the servos."""


class SensorConfig(Part):
    """Standard deviations of white noise on what the robot reports, and where its sensors sit."""

    position_rad: float = Field(default=3e-4, ge=0.0, le=0.1)
    """Joint positions."""
    velocity_rad_s: float = Field(default=0.03, ge=0.0, le=5.0)
    """Joint velocities."""
    load_nm: float = Field(default=0.4, ge=0.0, le=20.0)
    """Joint loads."""
    body_velocity_m_s: float = Field(default=0.015, ge=0.0, le=2.0)
    """Body velocity, each axis."""
    body_angular_velocity_rad_s: float = Field(default=0.01, ge=0.0, le=2.0)
    """Turn rate of the body, each axis."""
    attitude_rad: float = Field(default=0.001, ge=0.0, le=0.2)
    """Attitude of the body, each axis."""
    imu_acceleration_m_s2: float = Field(default=0.15, ge=0.0, le=10.0)
    """The inertial unit's accelerations."""
    imu_angular_velocity_rad_s: float = Field(default=0.008, ge=0.0, le=2.0)
    """The inertial unit's turn rates."""
    imu_from_body_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Position of the inertial unit in the body frame."""
    contact_threshold_n: float = Field(default=15.0, ge=0.0, le=200.0)
    """A foot is said to touch the ground above this normal force."""
    has_negated_imu_quaternion: bool = True
    """``odom_rot_link`` comes as −q: the same rotation with other components."""


class FrameConfig(Part):
    """Where the odometry frames start, relative to the true world."""

    odom_position_m: tuple[float, float, float] = (-1.3, 0.4, 0.33)
    """Origin of odom in the world, m. Its z makes odom report 0.19 m for a body that stands at 0.52 m, as recorded."""
    odom_yaw_rad: float = Field(default=-0.35, ge=-3.2, le=3.2)
    """Heading of odom in the world."""
    vision_position_m: tuple[float, float, float] = (0.2, -0.7, 0.31)
    """Origin of vision in the world."""
    vision_yaw_rad: float = Field(default=0.8, ge=-3.2, le=3.2)
    """Heading of vision in the world."""


class ClockConfig(Part):
    """The robot's clock against the host's."""

    skew_s: float = Field(default=ROBOT_CLOCK_SKEW_S, ge=-1e9, le=1e9)
    """Robot clock minus host clock at the start."""
    drift_ppm: float = Field(default=0.0, ge=-10_000.0, le=10_000.0)
    """How much faster robot time passes, in millionths; in lock-step without meaning."""
    start_unix_s: int | None = Field(default=None, ge=0, le=4_000_000_000)
    """Host time at the start, whole seconds; none for now. Give it to make stamps the same in every run."""


class BatteryConfig(Part):
    """The battery. Defaults are plausible for a pack of 58.8 V and 605 Wh, not identified."""

    charge_percent: float = Field(default=92.0, ge=0.0, le=100.0)
    """Initial charge."""
    energy_wh: float = Field(default=605.0, gt=0.0, le=5000.0)
    """Energy of a full battery."""
    full_voltage_v: float = Field(default=58.8, gt=10.0, le=100.0)
    """Open-circuit voltage when full."""
    empty_voltage_v: float = Field(default=44.0, gt=5.0, le=100.0)
    """Open-circuit voltage when empty."""
    resistance_ohm: float = Field(default=0.045, ge=0.0, le=2.0)
    """Internal resistance."""
    idle_power_w: float = Field(default=90.0, ge=0.0, le=1000.0)
    """Power of the computers and sensors."""
    motors_on_power_w: float = Field(default=60.0, ge=0.0, le=1000.0)
    """Drives that are on and idle."""
    temperature_c: float = Field(default=27.0, ge=-40.0, le=120.0)
    """Temperature of the cells."""
    critical_percent: float = Field(default=2.0, ge=0.0, le=50.0)
    """At or below it the robot raises a critical system fault and sits down."""

    @model_validator(mode="after")
    def _full_is_above_empty(self) -> BatteryConfig:
        if self.full_voltage_v <= self.empty_voltage_v:
            raise ValueError(f"full_voltage_v must be above empty_voltage_v = {self.empty_voltage_v:g} V")
        return self


class MotorConfig(Part):
    """Losses and heating of the twelve motors. Plausible, not identified."""

    hip_loss_w_per_nm2: float = Field(default=0.045, ge=0.0, le=10.0)
    """Copper loss of a hip per squared joint torque."""
    knee_loss_w_per_nm2: float = Field(default=0.025, ge=0.0, le=10.0)
    """Copper loss of a knee per squared joint torque."""
    regeneration_efficiency: float = Field(default=0.6, ge=0.0, le=1.0)
    """Share of braking power that returns to the battery."""
    heat_capacity_j_per_k: float = Field(default=420.0, gt=0.0, le=1e5)
    """Heat capacity of a motor."""
    thermal_resistance_k_per_w: float = Field(default=0.9, gt=0.0, le=100.0)
    """Thermal resistance from a motor to the air."""
    ambient_c: float = Field(default=22.0, ge=-40.0, le=60.0)
    """Temperature of the air."""
    start_temperature_c: float = Field(default=30.0, ge=-40.0, le=150.0)
    """Initial temperature of the motors."""
    limit_c: float = Field(default=95.0, ge=0.0, le=300.0)
    """Above it the robot raises a critical system fault."""


class PowerConfig(Part):
    """How long the motors' supply takes."""

    power_on_s: float = Field(default=2.0, ge=0.0, le=60.0)
    """From the command to motors with power."""
    power_off_s: float = Field(default=0.3, ge=0.0, le=10.0)
    """From the command to motors without power."""


class MotionConfig(Part):
    """The vendor's own stand and sit, as far as they can be seen from outside."""

    stand_s: float = Field(default=1.6, gt=0.1, le=20.0)
    """Duration of standing up."""
    sit_s: float = Field(default=1.6, gt=0.1, le=20.0)
    """Duration of sitting down."""
    stand_height_m: float = Field(default=0.52, gt=0.3, le=0.62)
    """Height of the body's origin over the ground in a stand without offset."""
    damping_nm_s_per_rad: float = Field(default=8.0, ge=0.0, le=100.0)
    """Damping of all joints while the robot sinks to the ground after a fault or an expired command."""
    damping_s: float = Field(default=3.0, gt=0.0, le=60.0)
    """How long it damps before the motors count as at rest (mode sitting, holding where they are)."""
    walking_policy: str | None = Field(default=None, min_length=1, max_length=4096)
    """Policy file that walks when a client sends the vendor's walking commands; the shipped one if none is given. A
    relative path starts at the scenario's file."""
    fall_tilt_rad: float = Field(default=1.05, gt=0.1, le=3.2)
    """A body tilted further, or lying on the ground while it should stand, has fallen."""


class JointControlConfig(Part):
    """Joint control: rules that cannot be known without a robot, each a named policy."""

    on_command_expiry: Literal["damp", "hold_vendor_stand", "freeze_torque"] = "damp"
    """What the body does once the newest command is past its end time, or the stream has ended. It damps the joints,
    returns to the vendor's own stand, or keeps the last torque for ``freeze_torque_s`` and then damps."""
    freeze_torque_s: float = Field(default=0.5, gt=0.0, le=5.0)
    """Duration of `freeze_torque`."""
    activation_wait_s: float = Field(default=5.0, ge=0.0, le=60.0)
    """How long a stream may run without joint control (then INACTIVE), and joint control without a command (then the
    robot returns to its stand)."""
    max_end_time_ahead_s: float = Field(default=10.0, gt=0.0, le=3600.0)
    """A command that ends further in the future is TOO_DISTANT."""
    max_first_setpoint_distance_rad: float | None = Field(default=None, gt=0.0, le=6.3)
    """If given, the first set-point in joint control may lie no further from the measured pose (else TOO_DISTANT)."""
    is_stopped_by_fall: bool = True
    """A fall raises a behaviour fault, which ends joint control; otherwise it is only reported."""


class RealTimeConfig(Part):
    """How robot time follows the host's clock in real-time mode."""

    max_catch_up_s: float = Field(default=0.25, gt=0.0, le=10.0)
    """After a stall the body catches up this much; what is beyond is lost from the robot's clock, and counted."""


class ServicesConfig(Part):
    """The ``services`` part of a scenario. Times are in seconds.

    Timeouts of leases and e-stop endpoints run on robot time. In lock-step they also wait for as much host time,
    because a client's keep-alive thread runs on the host's clock (``liveness_clock: both``).
    """

    serial_number: str = Field(default="spot-FAKE-00000001", min_length=1, max_length=64)
    nickname: str = Field(default="fake", max_length=64)
    software_version: tuple[int, int, int] = (5, 2, 0)

    operator_estop: bool = True
    """An operator holds a released e-stop endpoint at start, as the tablet of a real robot does. Without it the robot
    is stopped until a program registers an endpoint."""
    estop_cut_after_settle_s: float = Field(default=4.0, ge=0, le=60)
    """A silent endpoint first settles the robot; this much later it cuts power, unless the endpoint says otherwise."""

    lease_timeout_s: float = Field(default=6.0, gt=0, le=3600)
    """A lease that was neither used nor retained for this long is stale: its holder is refused, others may acquire."""
    on_lease_expiry: Literal["safe_power_off", "stop", "nothing"] = "safe_power_off"
    """What the robot does when its lease expires while the motors are on."""
    liveness_clock: Literal["both", "robot"] = "both"

    joint_control_license: Literal["valid", "expired", "missing"] = "valid"
    missing_license_refusal: Literal["unsupported", "invalid_request"] = "unsupported"
    """The status with which a joint request without a licence is refused."""

    token_lifetime_s: float = Field(default=12 * 3600.0, gt=0, le=30 * 86400)
    max_failed_logins: int = Field(default=10, ge=1)
    lockout_s: float = Field(default=30.0, ge=0, le=3600)
    """After ``max_failed_logins`` wrong passwords in a row, every login of that user is refused for this long."""

    time_sync_samples: int = Field(default=3, ge=1, le=25)
    """Round trips before the robot calls a client synchronised."""

    clock_identifier_check: Literal["every_command", "timed_commands", "none"] = "every_command"
    """Which robot commands are refused with NO_TIMESYNC unless they bear the identifier of a finished time sync: all,
    or those with an end time alone. The protos say that the identifier verifies time sync, not on which commands."""
    missing_end_time_refusal: Literal["expired", "invalid_request"] = "expired"
    """The status with which a timed command without an end time is refused."""
    max_command_duration_s: float = Field(default=600.0, gt=0, le=86400)
    """A robot command whose end time lies further ahead is TOO_DISTANT."""

    max_walking_speed_m_s: float = Field(default=1.6, gt=0, le=10)
    """Bound of the walking commands, forwards and to the side. Source: the vendor's data sheet."""
    max_turn_rate_rad_s: float = Field(default=2.0, gt=0, le=10)

    second_command_stream: Literal["refuse", "evict"] = "refuse"
    """What a second joint-control stream does while one is open."""
    max_command_rate_hz: float = Field(default=2000.0, gt=0)
    """A faster joint-control stream (mean over one second, real time only) is ended with INVALID_REQUEST."""

    cameras: Literal["scene", "test_card", "none"] = "scene"
    """What the image service has. ``scene``: cameras that see the simulated scene, and a test card where this computer
    cannot draw without a display. ``test_card``: cameras with a test card before each. ``none``: no camera."""

    max_concurrent_calls: int = Field(default=64, ge=4, le=1024)
    max_message_bytes: int = Field(default=4 * 1024 * 1024, ge=1024)
    """A larger request is refused with RESOURCE_EXHAUSTED."""

    reboot_s: float = Field(default=5.0, ge=0, le=600)
    """How long the services are away after a power cycle or a reboot."""
