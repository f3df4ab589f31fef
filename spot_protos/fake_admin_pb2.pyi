from google.protobuf.internal import containers as _containers
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Iterable as _Iterable, Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class GetStatusRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class GetStatusResponse(_message.Message):
    __slots__ = ("robot_stamp_ns", "lock_step", "mode", "motor_power", "estop_level", "lease_owner", "active_faults", "last_command_key", "last_state_robot_stamp_ns", "states_sent", "commands_received", "state_streams", "command_streams", "elapsed_ns", "commands_submitted", "step_socket")
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    LOCK_STEP_FIELD_NUMBER: _ClassVar[int]
    MODE_FIELD_NUMBER: _ClassVar[int]
    MOTOR_POWER_FIELD_NUMBER: _ClassVar[int]
    ESTOP_LEVEL_FIELD_NUMBER: _ClassVar[int]
    LEASE_OWNER_FIELD_NUMBER: _ClassVar[int]
    ACTIVE_FAULTS_FIELD_NUMBER: _ClassVar[int]
    LAST_COMMAND_KEY_FIELD_NUMBER: _ClassVar[int]
    LAST_STATE_ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    STATES_SENT_FIELD_NUMBER: _ClassVar[int]
    COMMANDS_RECEIVED_FIELD_NUMBER: _ClassVar[int]
    STATE_STREAMS_FIELD_NUMBER: _ClassVar[int]
    COMMAND_STREAMS_FIELD_NUMBER: _ClassVar[int]
    ELAPSED_NS_FIELD_NUMBER: _ClassVar[int]
    COMMANDS_SUBMITTED_FIELD_NUMBER: _ClassVar[int]
    STEP_SOCKET_FIELD_NUMBER: _ClassVar[int]
    robot_stamp_ns: int
    lock_step: bool
    mode: str
    motor_power: str
    estop_level: str
    lease_owner: str
    active_faults: _containers.RepeatedCompositeFieldContainer[ActiveFault]
    last_command_key: int
    last_state_robot_stamp_ns: int
    states_sent: int
    commands_received: int
    state_streams: int
    command_streams: int
    elapsed_ns: int
    commands_submitted: int
    step_socket: str
    def __init__(self, robot_stamp_ns: _Optional[int] = ..., lock_step: _Optional[bool] = ..., mode: _Optional[str] = ..., motor_power: _Optional[str] = ..., estop_level: _Optional[str] = ..., lease_owner: _Optional[str] = ..., active_faults: _Optional[_Iterable[_Union[ActiveFault, _Mapping]]] = ..., last_command_key: _Optional[int] = ..., last_state_robot_stamp_ns: _Optional[int] = ..., states_sent: _Optional[int] = ..., commands_received: _Optional[int] = ..., state_streams: _Optional[int] = ..., command_streams: _Optional[int] = ..., elapsed_ns: _Optional[int] = ..., commands_submitted: _Optional[int] = ..., step_socket: _Optional[str] = ...) -> None: ...

class StepRequest(_message.Message):
    __slots__ = ("duration_ns", "state_messages", "wait_for_command_key", "wait_timeout_s", "max_duration_ns", "with_states", "wait_beyond_commands", "command")
    DURATION_NS_FIELD_NUMBER: _ClassVar[int]
    STATE_MESSAGES_FIELD_NUMBER: _ClassVar[int]
    WAIT_FOR_COMMAND_KEY_FIELD_NUMBER: _ClassVar[int]
    WAIT_TIMEOUT_S_FIELD_NUMBER: _ClassVar[int]
    MAX_DURATION_NS_FIELD_NUMBER: _ClassVar[int]
    WITH_STATES_FIELD_NUMBER: _ClassVar[int]
    WAIT_BEYOND_COMMANDS_FIELD_NUMBER: _ClassVar[int]
    COMMAND_FIELD_NUMBER: _ClassVar[int]
    duration_ns: int
    state_messages: int
    wait_for_command_key: int
    wait_timeout_s: float
    max_duration_ns: int
    with_states: bool
    wait_beyond_commands: int
    command: bytes
    def __init__(self, duration_ns: _Optional[int] = ..., state_messages: _Optional[int] = ..., wait_for_command_key: _Optional[int] = ..., wait_timeout_s: _Optional[float] = ..., max_duration_ns: _Optional[int] = ..., with_states: _Optional[bool] = ..., wait_beyond_commands: _Optional[int] = ..., command: _Optional[bytes] = ...) -> None: ...

class StepResponse(_message.Message):
    __slots__ = ("robot_stamp_ns", "last_state_robot_stamp_ns", "states_sent", "states", "states_ended", "elapsed_ns", "refusal")
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    LAST_STATE_ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    STATES_SENT_FIELD_NUMBER: _ClassVar[int]
    STATES_FIELD_NUMBER: _ClassVar[int]
    STATES_ENDED_FIELD_NUMBER: _ClassVar[int]
    ELAPSED_NS_FIELD_NUMBER: _ClassVar[int]
    REFUSAL_FIELD_NUMBER: _ClassVar[int]
    robot_stamp_ns: int
    last_state_robot_stamp_ns: int
    states_sent: int
    states: _containers.RepeatedScalarFieldContainer[bytes]
    states_ended: str
    elapsed_ns: int
    refusal: str
    def __init__(self, robot_stamp_ns: _Optional[int] = ..., last_state_robot_stamp_ns: _Optional[int] = ..., states_sent: _Optional[int] = ..., states: _Optional[_Iterable[bytes]] = ..., states_ended: _Optional[str] = ..., elapsed_ns: _Optional[int] = ..., refusal: _Optional[str] = ...) -> None: ...

class ListFaultsRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ListFaultsResponse(_message.Message):
    __slots__ = ("faults",)
    FAULTS_FIELD_NUMBER: _ClassVar[int]
    faults: _containers.RepeatedCompositeFieldContainer[FaultDescription]
    def __init__(self, faults: _Optional[_Iterable[_Union[FaultDescription, _Mapping]]] = ...) -> None: ...

class FaultDescription(_message.Message):
    __slots__ = ("name", "help", "parameters")
    class ParametersEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    HELP_FIELD_NUMBER: _ClassVar[int]
    PARAMETERS_FIELD_NUMBER: _ClassVar[int]
    name: str
    help: str
    parameters: _containers.ScalarMap[str, str]
    def __init__(self, name: _Optional[str] = ..., help: _Optional[str] = ..., parameters: _Optional[_Mapping[str, str]] = ...) -> None: ...

class InjectFaultRequest(_message.Message):
    __slots__ = ("name", "numbers", "texts", "duration_s")
    class NumbersEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: float
        def __init__(self, key: _Optional[str] = ..., value: _Optional[float] = ...) -> None: ...
    class TextsEntry(_message.Message):
        __slots__ = ("key", "value")
        KEY_FIELD_NUMBER: _ClassVar[int]
        VALUE_FIELD_NUMBER: _ClassVar[int]
        key: str
        value: str
        def __init__(self, key: _Optional[str] = ..., value: _Optional[str] = ...) -> None: ...
    NAME_FIELD_NUMBER: _ClassVar[int]
    NUMBERS_FIELD_NUMBER: _ClassVar[int]
    TEXTS_FIELD_NUMBER: _ClassVar[int]
    DURATION_S_FIELD_NUMBER: _ClassVar[int]
    name: str
    numbers: _containers.ScalarMap[str, float]
    texts: _containers.ScalarMap[str, str]
    duration_s: float
    def __init__(self, name: _Optional[str] = ..., numbers: _Optional[_Mapping[str, float]] = ..., texts: _Optional[_Mapping[str, str]] = ..., duration_s: _Optional[float] = ...) -> None: ...

class InjectFaultResponse(_message.Message):
    __slots__ = ("fault_id", "robot_stamp_ns")
    FAULT_ID_FIELD_NUMBER: _ClassVar[int]
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    fault_id: int
    robot_stamp_ns: int
    def __init__(self, fault_id: _Optional[int] = ..., robot_stamp_ns: _Optional[int] = ...) -> None: ...

class ActiveFault(_message.Message):
    __slots__ = ("fault_id", "name")
    FAULT_ID_FIELD_NUMBER: _ClassVar[int]
    NAME_FIELD_NUMBER: _ClassVar[int]
    fault_id: int
    name: str
    def __init__(self, fault_id: _Optional[int] = ..., name: _Optional[str] = ...) -> None: ...

class ClearFaultsRequest(_message.Message):
    __slots__ = ("fault_ids",)
    FAULT_IDS_FIELD_NUMBER: _ClassVar[int]
    fault_ids: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, fault_ids: _Optional[_Iterable[int]] = ...) -> None: ...

class ClearFaultsResponse(_message.Message):
    __slots__ = ("cleared_fault_ids",)
    CLEARED_FAULT_IDS_FIELD_NUMBER: _ClassVar[int]
    cleared_fault_ids: _containers.RepeatedScalarFieldContainer[int]
    def __init__(self, cleared_fault_ids: _Optional[_Iterable[int]] = ...) -> None: ...

class GetTruthRequest(_message.Message):
    __slots__ = ("reset_extremes",)
    RESET_EXTREMES_FIELD_NUMBER: _ClassVar[int]
    reset_extremes: bool
    def __init__(self, reset_extremes: _Optional[bool] = ...) -> None: ...

class GetTruthResponse(_message.Message):
    __slots__ = ("robot_stamp_ns", "position_of_body_in_world_m", "world_from_body_wxyz", "linear_vel_of_body_in_world_m_s", "angular_vel_of_body_in_body_rad_s", "body_height_m", "joint_position_rad", "joint_velocity_rad_s", "joint_torque_nm", "foot_contact", "foot_force_n", "has_fallen", "body_height_min_m", "peak_torque_nm")
    ROBOT_STAMP_NS_FIELD_NUMBER: _ClassVar[int]
    POSITION_OF_BODY_IN_WORLD_M_FIELD_NUMBER: _ClassVar[int]
    WORLD_FROM_BODY_WXYZ_FIELD_NUMBER: _ClassVar[int]
    LINEAR_VEL_OF_BODY_IN_WORLD_M_S_FIELD_NUMBER: _ClassVar[int]
    ANGULAR_VEL_OF_BODY_IN_BODY_RAD_S_FIELD_NUMBER: _ClassVar[int]
    BODY_HEIGHT_M_FIELD_NUMBER: _ClassVar[int]
    JOINT_POSITION_RAD_FIELD_NUMBER: _ClassVar[int]
    JOINT_VELOCITY_RAD_S_FIELD_NUMBER: _ClassVar[int]
    JOINT_TORQUE_NM_FIELD_NUMBER: _ClassVar[int]
    FOOT_CONTACT_FIELD_NUMBER: _ClassVar[int]
    FOOT_FORCE_N_FIELD_NUMBER: _ClassVar[int]
    HAS_FALLEN_FIELD_NUMBER: _ClassVar[int]
    BODY_HEIGHT_MIN_M_FIELD_NUMBER: _ClassVar[int]
    PEAK_TORQUE_NM_FIELD_NUMBER: _ClassVar[int]
    robot_stamp_ns: int
    position_of_body_in_world_m: _containers.RepeatedScalarFieldContainer[float]
    world_from_body_wxyz: _containers.RepeatedScalarFieldContainer[float]
    linear_vel_of_body_in_world_m_s: _containers.RepeatedScalarFieldContainer[float]
    angular_vel_of_body_in_body_rad_s: _containers.RepeatedScalarFieldContainer[float]
    body_height_m: float
    joint_position_rad: _containers.RepeatedScalarFieldContainer[float]
    joint_velocity_rad_s: _containers.RepeatedScalarFieldContainer[float]
    joint_torque_nm: _containers.RepeatedScalarFieldContainer[float]
    foot_contact: _containers.RepeatedScalarFieldContainer[bool]
    foot_force_n: _containers.RepeatedScalarFieldContainer[float]
    has_fallen: bool
    body_height_min_m: float
    peak_torque_nm: float
    def __init__(self, robot_stamp_ns: _Optional[int] = ..., position_of_body_in_world_m: _Optional[_Iterable[float]] = ..., world_from_body_wxyz: _Optional[_Iterable[float]] = ..., linear_vel_of_body_in_world_m_s: _Optional[_Iterable[float]] = ..., angular_vel_of_body_in_body_rad_s: _Optional[_Iterable[float]] = ..., body_height_m: _Optional[float] = ..., joint_position_rad: _Optional[_Iterable[float]] = ..., joint_velocity_rad_s: _Optional[_Iterable[float]] = ..., joint_torque_nm: _Optional[_Iterable[float]] = ..., foot_contact: _Optional[_Iterable[bool]] = ..., foot_force_n: _Optional[_Iterable[float]] = ..., has_fallen: _Optional[bool] = ..., body_height_min_m: _Optional[float] = ..., peak_torque_nm: _Optional[float] = ...) -> None: ...

class ShutdownRequest(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...

class ShutdownResponse(_message.Message):
    __slots__ = ()
    def __init__(self) -> None: ...
