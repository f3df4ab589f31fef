from google.protobuf.internal import containers as _containers
from google.protobuf.internal import enum_type_wrapper as _enum_type_wrapper
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class Header(_message.Message):
    __slots__ = ("schema", "run_id", "started_host_stamp_ns", "robot_id", "adapter", "policy_name", "policy_sha256", "policy_contract_json", "config_json", "command_sequence", "repeat", "labels", "software_version", "software_revision", "joint_names", "foot_names")
    class LabelsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    SCHEMA_FIELD_NUMBER: _ClassVar[int]
    RUN_ID_FIELD_NUMBER: _ClassVar[int]
    STARTED_HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    ADAPTER_FIELD_NUMBER: _ClassVar[int]
    POLICY_NAME_FIELD_NUMBER: _ClassVar[int]
    POLICY_SHA256_FIELD_NUMBER: _ClassVar[int]
    POLICY_CONTRACT_JSON_FIELD_NUMBER: _ClassVar[int]
    CONFIG_JSON_FIELD_NUMBER: _ClassVar[int]
    COMMAND_SEQUENCE_FIELD_NUMBER: _ClassVar[int]
    REPEAT_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    SOFTWARE_VERSION_FIELD_NUMBER: _ClassVar[int]
    SOFTWARE_REVISION_FIELD_NUMBER: _ClassVar[int]
    JOINT_NAMES_FIELD_NUMBER: _ClassVar[int]
    FOOT_NAMES_FIELD_NUMBER: _ClassVar[int]
    schema: str
    run_id: str
    started_host_stamp_ns: int
    robot_id: str
    adapter: str
    policy_name: str
    policy_sha256: str
    policy_contract_json: str
    config_json: str
    command_sequence: str
    repeat: int
    labels: _containers.ScalarMap[str, str]
    software_version: str
    software_revision: str
    joint_names: _containers.RepeatedScalarFieldContainer[str]
    foot_names: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, schema: _Optional[str] = ..., run_id: _Optional[str] = ..., started_host_stamp_ns: _Optional[int] = ..., robot_id: _Optional[str] = ..., adapter: _Optional[str] = ..., policy_name: _Optional[str] = ..., policy_sha256: _Optional[str] = ..., policy_contract_json: _Optional[str] = ..., config_json: _Optional[str] = ..., command_sequence: _Optional[str] = ..., repeat: _Optional[int] = ..., labels: _Optional[_Mapping[str, str]] = ..., software_version: _Optional[str] = ..., software_revision: _Optional[str] = ..., joint_names: _Optional[_Iterable[str]] = ..., foot_names: _Optional[_Iterable[str]] = ...) -> None: ...

class ImuPacket(_message.Message):
    __slots__ = ("robot_stamp_ns", "acceleration_of_imu_in_link_m_s2", "angular_vel_of_link_in_link_rad_s", "odom_from_link_wxyz")
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    ACCELERATION_OF_IMU_IN_LINK_M_S2_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_VEL_OF_LINK_IN_LINK_RAD_S_FIELD_NUMBER: _ClassVar[int]
    ODOM_FROM_LINK_WXYZ_FIELD_NUMBER: _ClassVar[int]
    robot_stamp_ns: int
    acceleration_of_imu_in_link_m_s2: _containers.RepeatedScalarFieldContainer[float]
    angular_vel_of_link_in_link_rad_s: _containers.RepeatedScalarFieldContainer[float]
    odom_from_link_wxyz: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, robot_stamp_ns: _Optional[int] = ..., acceleration_of_imu_in_link_m_s2: _Optional[_Iterable[float]] = ..., angular_vel_of_link_in_link_rad_s: _Optional[_Iterable[float]] = ..., odom_from_link_wxyz: _Optional[_Iterable[float]] = ...) -> None: ...

class State(_message.Message):
    __slots__ = ("robot_stamp_ns", "host_stamp_ns", "position_rad", "velocity_rad_s", "load_nm", "position_of_body_in_odom_m", "odom_from_body_wxyz", "linear_vel_of_body_in_odom_m_s", "angular_vel_of_body_in_odom_rad_s", "foot_contact", "last_command_key", "last_command_robot_stamp_ns", "imu", "arm")
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    POSITION_RAD_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_RAD_S_FIELD_NUMBER: _ClassVar[int]
    LOAD_NM_FIELD_NUMBER: _ClassVar[int]
    POSITION_OF_BODY_IN_ODOM_M_FIELD_NUMBER: _ClassVar[int]
    ODOM_FROM_BODY_WXYZ_FIELD_NUMBER: _ClassVar[int]
    LINEAR_VEL_OF_BODY_IN_ODOM_M_S_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_VEL_OF_BODY_IN_ODOM_RAD_S_FIELD_NUMBER: _ClassVar[int]
    FOOT_CONTACT_FIELD_NUMBER: _ClassVar[int]
    LAST_COMMAND_KEY_FIELD_NUMBER: _ClassVar[int]
    LAST_COMMAND_ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    IMU_FIELD_NUMBER: _ClassVar[int]
    ARM_FIELD_NUMBER: _ClassVar[int]
    robot_stamp_ns: int
    host_stamp_ns: int
    position_rad: _containers.RepeatedScalarFieldContainer[float]
    velocity_rad_s: _containers.RepeatedScalarFieldContainer[float]
    load_nm: _containers.RepeatedScalarFieldContainer[float]
    position_of_body_in_odom_m: _containers.RepeatedScalarFieldContainer[float]
    odom_from_body_wxyz: _containers.RepeatedScalarFieldContainer[float]
    linear_vel_of_body_in_odom_m_s: _containers.RepeatedScalarFieldContainer[float]
    angular_vel_of_body_in_odom_rad_s: _containers.RepeatedScalarFieldContainer[float]
    foot_contact: _containers.RepeatedScalarFieldContainer[bool]
    last_command_key: int
    last_command_robot_stamp_ns: int
    imu: _containers.RepeatedCompositeFieldContainer[ImuPacket]
    arm: Arm
    def __init__(self, robot_stamp_ns: _Optional[int] = ..., host_stamp_ns: _Optional[int] = ..., position_rad: _Optional[_Iterable[float]] = ..., velocity_rad_s: _Optional[_Iterable[float]] = ..., load_nm: _Optional[_Iterable[float]] = ..., position_of_body_in_odom_m: _Optional[_Iterable[float]] = ..., odom_from_body_wxyz: _Optional[_Iterable[float]] = ..., linear_vel_of_body_in_odom_m_s: _Optional[_Iterable[float]] = ..., angular_vel_of_body_in_odom_rad_s: _Optional[_Iterable[float]] = ..., foot_contact: _Optional[_Iterable[bool]] = ..., last_command_key: _Optional[int] = ..., last_command_robot_stamp_ns: _Optional[int] = ..., imu: _Optional[_Iterable[_Union[ImuPacket, _Mapping]]] = ..., arm: _Optional[_Union[Arm, _Mapping]] = ...) -> None: ...

class Arm(_message.Message):
    __slots__ = ("robot_stamp_ns", "host_stamp_ns", "position_rad", "velocity_rad_s", "load_nm")
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    POSITION_RAD_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_RAD_S_FIELD_NUMBER: _ClassVar[int]
    LOAD_NM_FIELD_NUMBER: _ClassVar[int]
    robot_stamp_ns: int
    host_stamp_ns: int
    position_rad: _containers.RepeatedScalarFieldContainer[float]
    velocity_rad_s: _containers.RepeatedScalarFieldContainer[float]
    load_nm: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, robot_stamp_ns: _Optional[int] = ..., host_stamp_ns: _Optional[int] = ..., position_rad: _Optional[_Iterable[float]] = ..., velocity_rad_s: _Optional[_Iterable[float]] = ..., load_nm: _Optional[_Iterable[float]] = ...) -> None: ...

class Command(_message.Message):
    __slots__ = ("key", "host_stamp_ns", "robot_stamp_ns", "state_robot_stamp_ns", "end_robot_stamp_ns", "requested_position_rad", "position_rad", "velocity_rad_s", "load_nm", "kp_nm_per_rad", "kd_nm_s_per_rad")
    KEY_FIELD_NUMBER: _ClassVar[int]
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    END_ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    REQUESTED_POSITION_RAD_FIELD_NUMBER: _ClassVar[int]
    POSITION_RAD_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_RAD_S_FIELD_NUMBER: _ClassVar[int]
    LOAD_NM_FIELD_NUMBER: _ClassVar[int]
    KP_NM_PER_RAD_FIELD_NUMBER: _ClassVar[int]
    KD_NM_S_PER_RAD_FIELD_NUMBER: _ClassVar[int]
    key: int
    host_stamp_ns: int
    robot_stamp_ns: int
    state_robot_stamp_ns: int
    end_robot_stamp_ns: int
    requested_position_rad: _containers.RepeatedScalarFieldContainer[float]
    position_rad: _containers.RepeatedScalarFieldContainer[float]
    velocity_rad_s: _containers.RepeatedScalarFieldContainer[float]
    load_nm: _containers.RepeatedScalarFieldContainer[float]
    kp_nm_per_rad: _containers.RepeatedScalarFieldContainer[float]
    kd_nm_s_per_rad: _containers.RepeatedScalarFieldContainer[float]
    def __init__(self, key: _Optional[int] = ..., host_stamp_ns: _Optional[int] = ..., robot_stamp_ns: _Optional[int] = ..., state_robot_stamp_ns: _Optional[int] = ..., end_robot_stamp_ns: _Optional[int] = ..., requested_position_rad: _Optional[_Iterable[float]] = ..., position_rad: _Optional[_Iterable[float]] = ..., velocity_rad_s: _Optional[_Iterable[float]] = ..., load_nm: _Optional[_Iterable[float]] = ..., kp_nm_per_rad: _Optional[_Iterable[float]] = ..., kd_nm_s_per_rad: _Optional[_Iterable[float]] = ...) -> None: ...

class Tick(_message.Message):
    __slots__ = ("index", "robot_stamp_ns", "host_stamp_ns", "mode", "observation", "action", "velocity_command", "state_age_s", "inference_s", "compute_s", "command_key", "skipped")
    INDEX_FIELD_NUMBER: _ClassVar[int]
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    OBSERVATION_FIELD_NUMBER: _ClassVar[int]
    ACTION_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_COMMAND_FIELD_NUMBER: _ClassVar[int]
    STATE_AGE_S_FIELD_NUMBER: _ClassVar[int]
    INFERENCE_S_FIELD_NUMBER: _ClassVar[int]
    COMPUTE_S_FIELD_NUMBER: _ClassVar[int]
    COMMAND_KEY_FIELD_NUMBER: _ClassVar[int]
    SKIPPED_FIELD_NUMBER: _ClassVar[int]
    index: int
    robot_stamp_ns: int
    host_stamp_ns: int
    mode: str
    observation: _containers.RepeatedScalarFieldContainer[float]
    action: _containers.RepeatedScalarFieldContainer[float]
    velocity_command: _containers.RepeatedScalarFieldContainer[float]
    state_age_s: float
    inference_s: float
    compute_s: float
    command_key: int
    skipped: int
    def __init__(self, index: _Optional[int] = ..., robot_stamp_ns: _Optional[int] = ..., host_stamp_ns: _Optional[int] = ..., mode: _Optional[str] = ..., observation: _Optional[_Iterable[float]] = ..., action: _Optional[_Iterable[float]] = ..., velocity_command: _Optional[_Iterable[float]] = ..., state_age_s: _Optional[float] = ..., inference_s: _Optional[float] = ..., compute_s: _Optional[float] = ..., command_key: _Optional[int] = ..., skipped: _Optional[int] = ...) -> None: ...

class SlowState(_message.Message):
    __slots__ = ("robot_stamp_ns", "host_stamp_ns", "motors_powered", "estopped", "battery_charge_percent", "battery_voltage_v", "battery_current_a", "battery_temperature_c", "motor_temperature_c", "system_faults", "behavior_faults", "service_faults")
    class MotorTemperatureCEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    MOTORS_POWERED_FIELD_NUMBER: _ClassVar[int]
    ESTOPPED_FIELD_NUMBER: _ClassVar[int]
    BATTERY_CHARGE_PERCENT_FIELD_NUMBER: _ClassVar[int]
    BATTERY_VOLTAGE_V_FIELD_NUMBER: _ClassVar[int]
    BATTERY_CURRENT_A_FIELD_NUMBER: _ClassVar[int]
    BATTERY_TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    MOTOR_TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    SYSTEM_FAULTS_FIELD_NUMBER: _ClassVar[int]
    BEHAVIOR_FAULTS_FIELD_NUMBER: _ClassVar[int]
    SERVICE_FAULTS_FIELD_NUMBER: _ClassVar[int]
    robot_stamp_ns: int
    host_stamp_ns: int
    motors_powered: bool
    estopped: bool
    battery_charge_percent: float
    battery_voltage_v: float
    battery_current_a: float
    battery_temperature_c: _containers.RepeatedScalarFieldContainer[float]
    motor_temperature_c: _containers.ScalarMap[str, float]
    system_faults: _containers.RepeatedScalarFieldContainer[str]
    behavior_faults: _containers.RepeatedScalarFieldContainer[str]
    service_faults: _containers.RepeatedScalarFieldContainer[str]
    def __init__(self, robot_stamp_ns: _Optional[int] = ..., host_stamp_ns: _Optional[int] = ..., motors_powered: _Optional[bool] = ..., estopped: _Optional[bool] = ..., battery_charge_percent: _Optional[float] = ..., battery_voltage_v: _Optional[float] = ..., battery_current_a: _Optional[float] = ..., battery_temperature_c: _Optional[_Iterable[float]] = ..., motor_temperature_c: _Optional[_Mapping[str, float]] = ..., system_faults: _Optional[_Iterable[str]] = ..., behavior_faults: _Optional[_Iterable[str]] = ..., service_faults: _Optional[_Iterable[str]] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("host_stamp_ns", "robot_stamp_ns", "severity", "name", "text", "values")
    class Severity(int, metaclass=_enum_type_wrapper.EnumTypeWrapper):
        __slots__ = ()
        SEVERITY_UNSPECIFIED: _ClassVar[Event.Severity]
        INFO: _ClassVar[Event.Severity]
        WARNING: _ClassVar[Event.Severity]
        ERROR: _ClassVar[Event.Severity]
    SEVERITY_UNSPECIFIED: Event.Severity
    INFO: Event.Severity
    WARNING: Event.Severity
    ERROR: Event.Severity
    class ValuesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    SEVERITY_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    VALUES_FIELD_NUMBER: _ClassVar[int]
    host_stamp_ns: int
    robot_stamp_ns: int
    severity: Event.Severity
    name: str
    text: str
    values: _containers.ScalarMap[str, float]
    def __init__(self, host_stamp_ns: _Optional[int] = ..., robot_stamp_ns: _Optional[int] = ..., severity: _Optional[_Union[Event.Severity, str]] = ..., name: _Optional[str] = ..., text: _Optional[str] = ..., values: _Optional[_Mapping[str, float]] = ...) -> None: ...

class Footer(_message.Message):
    __slots__ = ("host_stamp_ns", "messages", "dropped", "outcome")
    class MessagesEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    class DroppedEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: int
        def __init__(self, key: _Optional[str] = ..., value: _Optional[int] = ...) -> None: ...
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    MESSAGES_FIELD_NUMBER: _ClassVar[int]
    DROPPED_FIELD_NUMBER: _ClassVar[int]
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    host_stamp_ns: int
    messages: _containers.ScalarMap[str, int]
    dropped: _containers.ScalarMap[str, int]
    outcome: str
    def __init__(self, host_stamp_ns: _Optional[int] = ..., messages: _Optional[_Mapping[str, int]] = ..., dropped: _Optional[_Mapping[str, int]] = ..., outcome: _Optional[str] = ...) -> None: ...
