#!/usr/bin/env bash
# rosbags 0.11.9: three traps in what AnyReader gives back of a ROS 2 bag that rosbags wrote itself.
#
# A message is no instance of the class of the same name of the type store that was handed in, since the bag brings its
# own definitions: isinstance and match by class fail, the attributes are right. Its arrays cannot be written to. And
# duration and end_time are one nanosecond more than metadata.yaml says, with both storages: an end that counts as
# past the last message, so a bag of one message lasts 1 ns, and length / (n - 1) is not the period.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "rosbags==0.11.9" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import tempfile
from importlib.metadata import version
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

assert version("rosbags") == "0.11.9"
store = get_typestore(Stores.ROS2_HUMBLE)
JointState, Header, Time = (
    store.types[name] for name in ("sensor_msgs/msg/JointState", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
)
NONE = np.zeros(0)
for plugin in (StoragePlugin.SQLITE3, StoragePlugin.MCAP):
    with tempfile.TemporaryDirectory() as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=plugin) as writer:
            joints = writer.add_connection("/joint_states", "sensor_msgs/msg/JointState", typestore=store)
            for second in (1, 2, 3):
                message = JointState(Header(Time(second, 0), "body"), ["knee"], np.array([0.1 * second]), NONE, NONE)
                writer.write(joints, second * 10**9, store.serialize_cdr(message, "sensor_msgs/msg/JointState"))
        assert "nanoseconds: 2000000000" in (bag / "metadata.yaml").read_text()
        with AnyReader([bag], default_typestore=store) as reader:
            connection, _, raw = next(iter(reader.messages()))
            read = reader.deserialize(raw, connection.msgtype)
            print(plugin.name, type(read).__name__, reader.duration, reader.end_time, read.position.flags.writeable)
            assert (reader.duration, reader.end_time) == (2 * 10**9 + 1, 3 * 10**9 + 1)
            assert read.position.tolist() == [0.1] and not read.position.flags.writeable
            assert type(read).__name__ == JointState.__name__ and not isinstance(read, JointState)
PY
