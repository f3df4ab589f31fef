#!/usr/bin/env bash
# mcap-ros2-support 0.6.0: a misspelt field of a message is dropped without a word, and reads as zero or empty.
#
# write_message takes a dictionary or an object, writes the fields that the definition names, and fills what it does not
# find there with zeros. {"postion": [0.1]} makes an empty position. A wrong kind of array (NumPy's) raises, a fraction
# in an integer field is cut off.
# Whoever writes ROS 2 messages so: compare the keys with the definition, or read the file back.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mcap-ros2-support==0.6.0" "mcap==1.6.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import io
from importlib.metadata import version

import numpy as np
from mcap_ros2.reader import read_ros2_messages
from mcap_ros2.writer import Writer

assert version("mcap-ros2-support") == "0.6.0"


def written(fields):
    """What is read of a message that was written with these fields: name, position and count."""
    file = io.BytesIO()
    writer = Writer(file)
    schema = writer.register_msgdef("my_msgs/msg/Joints", "string[] name\nfloat64[] position\nint32 count")
    writer.write_message("/joints", schema, fields, log_time=1)
    writer.finish()
    file.seek(0)
    message = next(iter(read_ros2_messages(file))).ros_msg
    return list(message.name), list(message.position), message.count


seen = written({"name": ["knee"], "postion": [0.1], "Count": 3})
print("misspelt:", seen)
assert seen == (["knee"], [], 0)
assert written({"name": ["knee"], "position": [0.1], "count": 3}) == (["knee"], [0.1], 3)
assert written({"count": 2.9}) == ([], [], 2)
try:
    written({"position": np.array([0.1])})
except ValueError as error:
    print("an array:", error)
else:
    raise AssertionError("an array was taken")
PY
