#!/usr/bin/env bash
# rosbags 0.11.9: an array of whole numbers in a field of floats is written bit by bit, and reads as almost zero.
#
# A JointState with position = np.array([1, 2]) holds 64-bit integers. The serializer copies their bytes, so the reader
# finds 4.9e-324 and 9.9e-324 rad. The same happens to floats in the other byte order. An array of another width
# (float32) raises, and so does a list, hence one believes that types are checked.
# Whoever writes bags: np.asarray(values, np.float64) before each message; np.array([0, 0, 1]) is what bites.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "rosbags==0.11.9" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import numpy as np
from rosbags.typesys import Stores, get_typestore

assert version("rosbags") == "0.11.9"
store = get_typestore(Stores.ROS2_HUMBLE)
NAME = "sensor_msgs/msg/JointState"
JointState, Header, Time = (store.types[n] for n in (NAME, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
NONE = np.zeros(0)


def read(position):
    """The positions that are read of a message that was written with these."""
    message = JointState(Header(Time(1, 0), "body"), ["hip", "knee"], position, NONE, NONE)
    return store.deserialize_cdr(store.serialize_cdr(message, NAME), NAME).position


VALUES = [1.0, 2.0]
assert read(np.array(VALUES)).tolist() == VALUES
for kind in ("int64", ">f8"):
    seen = read(np.array(VALUES).astype(kind))
    print(f"{VALUES} as {kind} is read as {seen}")
    assert seen.dtype == np.float64 and (0.0 < seen).all() and (seen < 1e-300).all()
for wrong in (np.array(VALUES, np.float32), VALUES):
    try:
        read(wrong)
    except (ValueError, AttributeError) as error:
        print(f"{getattr(wrong, 'dtype', 'list')}: {error}")
    else:
        raise AssertionError("it was written")
PY
