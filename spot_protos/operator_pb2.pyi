from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class GetStatusRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class WatchStatusRequest(_message.Message):
    __slots__ = ("rate_hz",)
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    rate_hz: float
    def __init__(self, rate_hz: _Optional[float] = ...) -> None: ...

class ListModesRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ListModesResponse(_message.Message):
    __slots__ = ("states", "modes")
    class Mode(_message.Message):
        __slots__ = ("name", "meaning", "allows")
        NAME_FIELD_NUMBER: _ClassVar[int]
        MEANING_FIELD_NUMBER: _ClassVar[int]
        ALLOWS_FIELD_NUMBER: _ClassVar[int]
        name: str
        meaning: str
        allows: _containers.RepeatedScalarFieldContainer[str]
        def __init__(self, name: _Optional[str] = ..., meaning: _Optional[str] = ..., allows: _Optional[_Iterable[str]] = ...) -> None: ...
    STATES_FIELD_NUMBER: _ClassVar[int]
    MODES_FIELD_NUMBER: _ClassVar[int]
    states: _containers.RepeatedCompositeFieldContainer[ListModesResponse.Mode]
    modes: _containers.RepeatedCompositeFieldContainer[ListModesResponse.Mode]
    def __init__(self, states: _Optional[_Iterable[_Union[ListModesResponse.Mode, _Mapping]]] = ..., modes: _Optional[_Iterable[_Union[ListModesResponse.Mode, _Mapping]]] = ...) -> None: ...

class ListPoliciesRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ListPoliciesResponse(_message.Message):
    __slots__ = ("policies",)
    class Policy(_message.Message):
        __slots__ = ("name", "sha256", "size_bytes", "is_allowed")
        NAME_FIELD_NUMBER: _ClassVar[int]
        SHA256_FIELD_NUMBER: _ClassVar[int]
        SIZE_BYTES_FIELD_NUMBER: _ClassVar[int]
        IS_ALLOWED_FIELD_NUMBER: _ClassVar[int]
        name: str
        sha256: str
        size_bytes: int
        is_allowed: bool
        def __init__(self, name: _Optional[str] = ..., sha256: _Optional[str] = ..., size_bytes: _Optional[int] = ..., is_allowed: _Optional[bool] = ...) -> None: ...
    POLICIES_FIELD_NUMBER: _ClassVar[int]
    policies: _containers.RepeatedCompositeFieldContainer[ListPoliciesResponse.Policy]
    def __init__(self, policies: _Optional[_Iterable[_Union[ListPoliciesResponse.Policy, _Mapping]]] = ...) -> None: ...

class StreamEventsRequest(_message.Message):
    __slots__ = ("past",)
    PAST_FIELD_NUMBER: _ClassVar[int]
    past: int
    def __init__(self, past: _Optional[int] = ...) -> None: ...

class Event(_message.Message):
    __slots__ = ("host_stamp_ns", "robot_stamp_ns", "severity", "name", "text", "values", "number")
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
    NUMBER_FIELD_NUMBER: _ClassVar[int]
    host_stamp_ns: int
    robot_stamp_ns: int
    severity: str
    name: str
    text: str
    values: _containers.ScalarMap[str, float]
    number: int
    def __init__(self, host_stamp_ns: _Optional[int] = ..., robot_stamp_ns: _Optional[int] = ..., severity: _Optional[str] = ..., name: _Optional[str] = ..., text: _Optional[str] = ..., values: _Optional[_Mapping[str, float]] = ..., number: _Optional[int] = ...) -> None: ...

class ArmRequest(_message.Message):
    __slots__ = ("policy", "sha256", "labels", "operator")
    class LabelsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    POLICY_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    LABELS_FIELD_NUMBER: _ClassVar[int]
    OPERATOR_FIELD_NUMBER: _ClassVar[int]
    policy: str
    sha256: str
    labels: _containers.ScalarMap[str, str]
    operator: str
    def __init__(self, policy: _Optional[str] = ..., sha256: _Optional[str] = ..., labels: _Optional[_Mapping[str, str]] = ..., operator: _Optional[str] = ...) -> None: ...

class StartRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class StopRequest(_message.Message):
    __slots__ = ("keep_standing",)
    KEEP_STANDING_FIELD_NUMBER: _ClassVar[int]
    keep_standing: bool
    def __init__(self, keep_standing: _Optional[bool] = ...) -> None: ...

class DampRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class SetVelocityRequest(_message.Message):
    __slots__ = ("v_x_m_s", "v_y_m_s", "yaw_rate_rad_s", "operator")
    V_X_M_S_FIELD_NUMBER: _ClassVar[int]
    V_Y_M_S_FIELD_NUMBER: _ClassVar[int]
    YAW_RATE_RAD_S_FIELD_NUMBER: _ClassVar[int]
    OPERATOR_FIELD_NUMBER: _ClassVar[int]
    v_x_m_s: float
    v_y_m_s: float
    yaw_rate_rad_s: float
    operator: str
    def __init__(self, v_x_m_s: _Optional[float] = ..., v_y_m_s: _Optional[float] = ..., yaw_rate_rad_s: _Optional[float] = ..., operator: _Optional[str] = ...) -> None: ...

class SwitchPolicyRequest(_message.Message):
    __slots__ = ("policy", "sha256")
    POLICY_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    policy: str
    sha256: str
    def __init__(self, policy: _Optional[str] = ..., sha256: _Optional[str] = ...) -> None: ...

class StartLogRequest(_message.Message):
    __slots__ = ("labels",)
    class LabelsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    LABELS_FIELD_NUMBER: _ClassVar[int]
    labels: _containers.ScalarMap[str, str]
    def __init__(self, labels: _Optional[_Mapping[str, str]] = ...) -> None: ...

class StartLogResponse(_message.Message):
    __slots__ = ("path",)
    PATH_FIELD_NUMBER: _ClassVar[int]
    path: str
    def __init__(self, path: _Optional[str] = ...) -> None: ...

class LabelLogRequest(_message.Message):
    __slots__ = ("labels",)
    class LabelsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    LABELS_FIELD_NUMBER: _ClassVar[int]
    labels: _containers.ScalarMap[str, str]
    def __init__(self, labels: _Optional[_Mapping[str, str]] = ...) -> None: ...

class AttendRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class Done(_message.Message):
    __slots__ = ("state", "text")
    STATE_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    state: str
    text: str
    def __init__(self, state: _Optional[str] = ..., text: _Optional[str] = ...) -> None: ...

class Status(_message.Message):
    __slots__ = ("state", "robot", "software_version", "host_stamp_ns", "run", "run_age_s", "last", "steered_by", "attendance_left_s", "events")
    STATE_FIELD_NUMBER: _ClassVar[int]
    ROBOT_FIELD_NUMBER: _ClassVar[int]
    SOFTWARE_VERSION_FIELD_NUMBER: _ClassVar[int]
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    RUN_FIELD_NUMBER: _ClassVar[int]
    RUN_AGE_S_FIELD_NUMBER: _ClassVar[int]
    LAST_FIELD_NUMBER: _ClassVar[int]
    STEERED_BY_FIELD_NUMBER: _ClassVar[int]
    ATTENDANCE_LEFT_S_FIELD_NUMBER: _ClassVar[int]
    EVENTS_FIELD_NUMBER: _ClassVar[int]
    state: str
    robot: str
    software_version: str
    host_stamp_ns: int
    run: RunStatus
    run_age_s: float
    last: Outcome
    steered_by: str
    attendance_left_s: float
    events: int
    def __init__(self, state: _Optional[str] = ..., robot: _Optional[str] = ..., software_version: _Optional[str] = ..., host_stamp_ns: _Optional[int] = ..., run: _Optional[_Union[RunStatus, _Mapping]] = ..., run_age_s: _Optional[float] = ..., last: _Optional[_Union[Outcome, _Mapping]] = ..., steered_by: _Optional[str] = ..., attendance_left_s: _Optional[float] = ..., events: _Optional[int] = ...) -> None: ...

class RunStatus(_message.Message):
    __slots__ = ("mode", "robot_id", "policy", "policy_sha256", "velocity_command", "velocity_command_low", "velocity_command_high", "active_s", "rate_hz", "ticks", "skipped_ticks", "state_age_p50_s", "state_age_p99_s", "compute_p50_s", "compute_p99_s", "motors_powered", "estopped", "battery_charge_percent", "battery_voltage_v", "motor_temperature_c", "faults", "log_path", "log_dropped", "log_problem", "untold", "velocity_measured", "tilt_rad")
    class MotorTemperatureCEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    MODE_FIELD_NUMBER: _ClassVar[int]
    ROBOT_ID_FIELD_NUMBER: _ClassVar[int]
    POLICY_FIELD_NUMBER: _ClassVar[int]
    POLICY_SHA256_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_COMMAND_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_COMMAND_LOW_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_COMMAND_HIGH_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_S_FIELD_NUMBER: _ClassVar[int]
    RATE_HZ_FIELD_NUMBER: _ClassVar[int]
    TICKS_FIELD_NUMBER: _ClassVar[int]
    SKIPPED_TICKS_FIELD_NUMBER: _ClassVar[int]
    STATE_AGE_P50_S_FIELD_NUMBER: _ClassVar[int]
    STATE_AGE_P99_S_FIELD_NUMBER: _ClassVar[int]
    COMPUTE_P50_S_FIELD_NUMBER: _ClassVar[int]
    COMPUTE_P99_S_FIELD_NUMBER: _ClassVar[int]
    MOTORS_POWERED_FIELD_NUMBER: _ClassVar[int]
    ESTOPPED_FIELD_NUMBER: _ClassVar[int]
    BATTERY_CHARGE_PERCENT_FIELD_NUMBER: _ClassVar[int]
    BATTERY_VOLTAGE_V_FIELD_NUMBER: _ClassVar[int]
    MOTOR_TEMPERATURE_C_FIELD_NUMBER: _ClassVar[int]
    FAULTS_FIELD_NUMBER: _ClassVar[int]
    LOG_PATH_FIELD_NUMBER: _ClassVar[int]
    LOG_DROPPED_FIELD_NUMBER: _ClassVar[int]
    LOG_PROBLEM_FIELD_NUMBER: _ClassVar[int]
    UNTOLD_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_MEASURED_FIELD_NUMBER: _ClassVar[int]
    TILT_RAD_FIELD_NUMBER: _ClassVar[int]
    mode: str
    robot_id: str
    policy: str
    policy_sha256: str
    velocity_command: _containers.RepeatedScalarFieldContainer[float]
    velocity_command_low: _containers.RepeatedScalarFieldContainer[float]
    velocity_command_high: _containers.RepeatedScalarFieldContainer[float]
    active_s: float
    rate_hz: float
    ticks: int
    skipped_ticks: int
    state_age_p50_s: float
    state_age_p99_s: float
    compute_p50_s: float
    compute_p99_s: float
    motors_powered: bool
    estopped: bool
    battery_charge_percent: float
    battery_voltage_v: float
    motor_temperature_c: _containers.ScalarMap[str, float]
    faults: _containers.RepeatedScalarFieldContainer[str]
    log_path: str
    log_dropped: int
    log_problem: str
    untold: int
    velocity_measured: _containers.RepeatedScalarFieldContainer[float]
    tilt_rad: float
    def __init__(self, mode: _Optional[str] = ..., robot_id: _Optional[str] = ..., policy: _Optional[str] = ..., policy_sha256: _Optional[str] = ..., velocity_command: _Optional[_Iterable[float]] = ..., velocity_command_low: _Optional[_Iterable[float]] = ..., velocity_command_high: _Optional[_Iterable[float]] = ..., active_s: _Optional[float] = ..., rate_hz: _Optional[float] = ..., ticks: _Optional[int] = ..., skipped_ticks: _Optional[int] = ..., state_age_p50_s: _Optional[float] = ..., state_age_p99_s: _Optional[float] = ..., compute_p50_s: _Optional[float] = ..., compute_p99_s: _Optional[float] = ..., motors_powered: _Optional[bool] = ..., estopped: _Optional[bool] = ..., battery_charge_percent: _Optional[float] = ..., battery_voltage_v: _Optional[float] = ..., motor_temperature_c: _Optional[_Mapping[str, float]] = ..., faults: _Optional[_Iterable[str]] = ..., log_path: _Optional[str] = ..., log_dropped: _Optional[int] = ..., log_problem: _Optional[str] = ..., untold: _Optional[int] = ..., velocity_measured: _Optional[_Iterable[float]] = ..., tilt_rad: _Optional[float] = ...) -> None: ...

class Outcome(_message.Message):
    __slots__ = ("outcome", "exit_code", "sentence", "log_paths", "host_stamp_ns")
    OUTCOME_FIELD_NUMBER: _ClassVar[int]
    EXIT_CODE_FIELD_NUMBER: _ClassVar[int]
    SENTENCE_FIELD_NUMBER: _ClassVar[int]
    LOG_PATHS_FIELD_NUMBER: _ClassVar[int]
    HOST_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    outcome: str
    exit_code: int
    sentence: str
    log_paths: _containers.RepeatedScalarFieldContainer[str]
    host_stamp_ns: int
    def __init__(self, outcome: _Optional[str] = ..., exit_code: _Optional[int] = ..., sentence: _Optional[str] = ..., log_paths: _Optional[_Iterable[str]] = ..., host_stamp_ns: _Optional[int] = ...) -> None: ...
