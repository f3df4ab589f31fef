#!/usr/bin/env bash
# mcap-protobuf-support 0.6.0: a message that is written with its log time alone is published now.
#
# write_message(topic, message, log_time=t) takes publish_time from the computer's clock. A log of last year that is
# converted so says that all of it was published today, and two conversions of the same log differ. The sister package
# mcap-ros2-support 0.6.0, with the same two optional arguments, sets publish_time to log_time.
# Whoever converts or merges logs: pass both. Whoever reads them: a publish time may be that of a conversion.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mcap-protobuf-support==0.6.0" "mcap-ros2-support==0.6.0" \
  "mcap==1.6.0" "protobuf==7.36.2"
"$folder/venv/bin/python" - <<'PY'
import io
import time
from importlib.metadata import version

from google.protobuf.wrappers_pb2 import DoubleValue
from mcap.reader import make_reader
from mcap_protobuf.writer import Writer as ProtobufWriter
from mcap_ros2.writer import Writer as Ros2Writer

assert version("mcap-protobuf-support") == version("mcap-ros2-support") == "0.6.0"
LOGGED = 1_700_000_000_000_000_000


def times(file):
    """Log and publish time of the only message."""
    file.seek(0)
    _, _, message = next(make_reader(file).iter_messages())
    return message.log_time, message.publish_time


protobuf, ros2 = io.BytesIO(), io.BytesIO()
before = time.time_ns()
with ProtobufWriter(protobuf) as writer:
    writer.write_message("/height", DoubleValue(value=0.5), log_time=LOGGED)
writer = Ros2Writer(ros2)
schema = writer.register_msgdef("std_msgs/msg/Float64", "float64 data")
writer.write_message("/height", schema, {"data": 0.5}, log_time=LOGGED)
writer.finish()
for name, file in (("protobuf", protobuf), ("ros2", ros2)):
    logged, published = times(file)
    print(f"{name}: published {(published - logged) / 86400e9:.1f} days after it was logged")
    assert logged == LOGGED
assert before <= times(protobuf)[1] <= time.time_ns()
assert times(ros2)[1] == LOGGED
PY
