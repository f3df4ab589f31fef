from spot_protos import log_pb2 as _log_pb2
from spot_protos import operator_pb2 as _operator_pb2
from google.protobuf import descriptor as _descriptor
from google.protobuf import message as _message
from collections.abc import Mapping as _Mapping
from typing import ClassVar as _ClassVar, Optional as _Optional, Union as _Union

DESCRIPTOR: _descriptor.FileDescriptor

class ToRun(_message.Message):
    __slots__ = ("request_id", "velocity", "start", "stop", "damp", "switch_policy", "start_log", "label_log", "attend")
    REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    VELOCITY_FIELD_NUMBER: _ClassVar[int]
    START_FIELD_NUMBER: _ClassVar[int]
    STOP_FIELD_NUMBER: _ClassVar[int]
    DAMP_FIELD_NUMBER: _ClassVar[int]
    SWITCH_POLICY_FIELD_NUMBER: _ClassVar[int]
    START_LOG_FIELD_NUMBER: _ClassVar[int]
    LABEL_LOG_FIELD_NUMBER: _ClassVar[int]
    ATTEND_FIELD_NUMBER: _ClassVar[int]
    request_id: int
    velocity: Velocity
    start: _operator_pb2.StartRequest
    stop: _operator_pb2.StopRequest
    damp: _operator_pb2.DampRequest
    switch_policy: SwitchPolicy
    start_log: _operator_pb2.StartLogRequest
    label_log: _operator_pb2.LabelLogRequest
    attend: _operator_pb2.AttendRequest
    def __init__(self, request_id: _Optional[int] = ..., velocity: _Optional[_Union[Velocity, _Mapping]] = ..., start: _Optional[_Union[_operator_pb2.StartRequest, _Mapping]] = ..., stop: _Optional[_Union[_operator_pb2.StopRequest, _Mapping]] = ..., damp: _Optional[_Union[_operator_pb2.DampRequest, _Mapping]] = ..., switch_policy: _Optional[_Union[SwitchPolicy, _Mapping]] = ..., start_log: _Optional[_Union[_operator_pb2.StartLogRequest, _Mapping]] = ..., label_log: _Optional[_Union[_operator_pb2.LabelLogRequest, _Mapping]] = ..., attend: _Optional[_Union[_operator_pb2.AttendRequest, _Mapping]] = ...) -> None: ...

class Velocity(_message.Message):
    __slots__ = ("v_x_m_s", "v_y_m_s", "yaw_rate_rad_s")
    V_X_M_S_FIELD_NUMBER: _ClassVar[int]
    V_Y_M_S_FIELD_NUMBER: _ClassVar[int]
    YAW_RATE_RAD_S_FIELD_NUMBER: _ClassVar[int]
    v_x_m_s: float
    v_y_m_s: float
    yaw_rate_rad_s: float
    def __init__(self, v_x_m_s: _Optional[float] = ..., v_y_m_s: _Optional[float] = ..., yaw_rate_rad_s: _Optional[float] = ...) -> None: ...

class SwitchPolicy(_message.Message):
    __slots__ = ("path", "sha256")
    PATH_FIELD_NUMBER: _ClassVar[int]
    SHA256_FIELD_NUMBER: _ClassVar[int]
    path: str
    sha256: str
    def __init__(self, path: _Optional[str] = ..., sha256: _Optional[str] = ...) -> None: ...

class FromRun(_message.Message):
    __slots__ = ("answer", "status", "event", "state", "ended")
    ANSWER_FIELD_NUMBER: _ClassVar[int]
    STATUS_FIELD_NUMBER: _ClassVar[int]
    EVENT_FIELD_NUMBER: _ClassVar[int]
    STATE_FIELD_NUMBER: _ClassVar[int]
    ENDED_FIELD_NUMBER: _ClassVar[int]
    answer: Answer
    status: _operator_pb2.RunStatus
    event: _log_pb2.Event
    state: str
    ended: _operator_pb2.Outcome
    def __init__(self, answer: _Optional[_Union[Answer, _Mapping]] = ..., status: _Optional[_Union[_operator_pb2.RunStatus, _Mapping]] = ..., event: _Optional[_Union[_log_pb2.Event, _Mapping]] = ..., state: _Optional[str] = ..., ended: _Optional[_Union[_operator_pb2.Outcome, _Mapping]] = ...) -> None: ...

class Answer(_message.Message):
    __slots__ = ("request_id", "is_done", "text")
    REQUEST_ID_FIELD_NUMBER: _ClassVar[int]
    IS_DONE_FIELD_NUMBER: _ClassVar[int]
    TEXT_FIELD_NUMBER: _ClassVar[int]
    request_id: int
    is_done: bool
    text: str
    def __init__(self, request_id: _Optional[int] = ..., is_done: _Optional[bool] = ..., text: _Optional[str] = ...) -> None: ...
