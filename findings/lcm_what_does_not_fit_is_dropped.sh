#!/usr/bin/env bash
# lcm 1.5.3: numbers beyond the length that a message states are dropped, and an array of whole numbers shifts the rest.
#
# In Python a message's array and the field with its length are set apart. Where the field was forgotten it is zero, and
# encode() writes an empty array without an error; of four numbers for q[3] the last is dropped; only too few raise. An
# array of bytes is written as it lies in memory: np.array([1, 2, 3]), of eight bytes each, takes 24 bytes instead of
# three, and every field behind it is read from the wrong place. A list, or an array of uint8, is right. Whoever logs:
# set the length from the array itself, and give bytes(list).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "lcm==1.5.3" "numpy==2.4.6"
cd "$folder"
cat >robot.lcm <<'LCM'
package robot;
struct legs_t {
    double q[3];
    int32_t joints;
    double torque[joints];
    int32_t feet;
    byte contact[feet];
    double temperature;
}
LCM
venv/bin/lcm-gen --python robot.lcm
venv/bin/python - <<'PY'
import struct
from importlib.metadata import version
from typing import Any

import numpy as np

from robot import legs_t

assert version("lcm") == "1.5.3"


def sent_and_read(**fields: Any) -> legs_t:
    legs = legs_t()
    for name, value in {"temperature": 20.0, **fields}.items():
        setattr(legs, name, value)
    return legs_t.decode(legs.encode())


assert sent_and_read(joints=2, torque=[5.0, 6.0]).torque == (5.0, 6.0)
forgotten, short = sent_and_read(torque=[5.0, 6.0]), sent_and_read(joints=1, torque=[5.0, 6.0])
print("torque [5, 6] with no length:", forgotten.torque, "and with length 1:", short.torque)
assert forgotten.torque == () and short.torque == (5.0,)
four = sent_and_read(q=[1.0, 2.0, 3.0, 4.0])
print("q of four numbers:", four.q)
assert four.q == (1.0, 2.0, 3.0)
try:
    sent_and_read(joints=3, torque=[5.0, 6.0])
except struct.error as error:
    print("too few:", error)
else:
    raise AssertionError("too few numbers are taken now")
for kind in (list, lambda numbers: np.array(numbers, np.uint8)):
    legs = sent_and_read(feet=3, contact=kind([1, 2, 3]))
    assert legs.contact == b"\x01\x02\x03" and legs.temperature == 20.0
legs = sent_and_read(feet=3, contact=np.array([1, 2, 3]))
print("bytes from np.array([1, 2, 3]):", legs.contact, "and then the temperature, 20.0, is", legs.temperature)
assert legs.contact == b"\x01\x00\x00" and legs.temperature != 20.0
PY
