#!/usr/bin/env bash
# foxglove-sdk 0.30.3: a message with a number that is not finite is recorded as JSON that strict readers refuse.
#
# Channel.log takes a dict and writes it as Python does: NaN and Infinity stand in the file as bare words. Robots send
# them: a joint without an estimate, a time to contact that is not known. Python's json reads them back, so a check with
# Python finds nothing; strict readers, as those of JavaScript and orjson, refuse the whole message, and the other
# numbers in it are lost with it. Nothing is said when it is logged. A message's default rotation is no rotation, too:
# Quaternion() is all zeros. Whoever logs dicts: put None for what is not finite; the typed messages (protobuf) carry
# NaN.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "foxglove-sdk==0.30.3" "mcap==1.6.0" "orjson==3.13.0"
"$folder/venv/bin/python" - "$folder" <<'PY'
import json
import sys
from importlib.metadata import version
from pathlib import Path

import foxglove
import orjson
from foxglove import Channel
from foxglove.messages import Quaternion
from mcap.reader import make_reader

assert version("foxglove-sdk") == "0.30.3"
path = Path(sys.argv[1]) / "joint.mcap"
with foxglove.open_mcap(path):
    channel = Channel("/joint")
    channel.log({"position": 0.5, "velocity": float("nan")}, log_time=1)
    channel.log({"position": 0.6, "contact_in": float("inf")}, log_time=2)
with path.open("rb") as file:
    recorded = [(kind.message_encoding, message.data) for _, kind, message in make_reader(file).iter_messages()]
print("recorded:", recorded)
assert [encoding for encoding, _ in recorded] == ["json", "json"]
assert b"NaN" in recorded[0][1] and b"Infinity" in recorded[1][1]

for _, data in recorded:
    json.loads(data)
    try:
        orjson.loads(data)
    except orjson.JSONDecodeError as error:
        print("refused:", error)
    else:
        raise AssertionError("it is JSON now")
default = Quaternion()
assert "x=0.0, y=0.0, z=0.0, w=0.0" in repr(default)
print("default rotation:", default)
PY
