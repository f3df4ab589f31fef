"""The log's topics: their names, channel numbers and message types."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message
from mcap_protobuf.schema import build_file_descriptor_set

from spot_protos import log_pb2


@dataclass(frozen=True)
class Topic:
    """One channel of the file. The numbers are fixed, so a damaged file can still be told apart."""

    channel_id: int
    name: str
    message_type: type[Message]

    @property
    def schema_name(self) -> str:
        """Full name of the protobuf message."""
        return str(self.message_type.DESCRIPTOR.full_name)

    def schema_data(self) -> bytes:
        """Serialised FileDescriptorSet of the message's file and all that it imports."""
        return build_file_descriptor_set(self.message_type).SerializeToString()


HEADER: Final = Topic(1, "/header", log_pb2.Header)
STATE: Final = Topic(2, "/state", log_pb2.State)
COMMAND: Final = Topic(3, "/command", log_pb2.Command)
TICK: Final = Topic(4, "/tick", log_pb2.Tick)
SLOW_STATE: Final = Topic(5, "/slow_state", log_pb2.SlowState)
EVENT: Final = Topic(6, "/event", log_pb2.Event)
FOOTER: Final = Topic(7, "/footer", log_pb2.Footer)
OWN_TOPICS: Final = (HEADER, STATE, COMMAND, TICK, SLOW_STATE, EVENT, FOOTER)

JOINT_STATES: Final = Topic(11, "/joint_states", JointStates)
TRANSFORMS: Final = Topic(12, "/tf", FrameTransforms)
ODOMETRY: Final = Topic(13, "/odometry", Odometry)
EVENT_TEXT: Final = Topic(14, "/log", Log)
SCENE: Final = Topic(15, "/scene", SceneUpdate)
VIEWER_TOPICS: Final = (JOINT_STATES, TRANSFORMS, ODOMETRY, EVENT_TEXT, SCENE)
"""What Foxglove shows without set-up; nothing of ours reads them back."""

ALL_TOPICS: Final = OWN_TOPICS + VIEWER_TOPICS
