#!/usr/bin/env bash
# bosdyn-core 5.2.0: a time just before a full second, turned into a protobuf Timestamp, becomes a whole second later.
#
# nsec_to_timestamp and set_timestamp_from_nsec of bosdyn.util divide whole nanoseconds by 1e9 as floats. Today's times
# have steps of 0.24 us there, so the last 119 ns of each second round up to the next one, while the nanoseconds stay:
# back as nanoseconds, the stamp is 1,000,000,000 too large. RobotTimeConverter goes through the same function, so a
# command whose end falls there ends a second later. Half a second before 1970 is a second off, too.
# Whoever converts integer stamps: Timestamp.FromNanoseconds of protobuf is exact.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "bosdyn-core==5.2.0" "bosdyn-api==5.2.0" "protobuf==7.36.2"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

from bosdyn.util import RobotTimeConverter, nsec_to_timestamp, timestamp_to_nsec
from google.protobuf.timestamp_pb2 import Timestamp

assert version("bosdyn-core") == "5.2.0"
SECOND = 10**9
start = 1_800_000_000 * SECOND
errors = [timestamp_to_nsec(nsec_to_timestamp(start + ns)) - start - ns for ns in range(SECOND - 1000, SECOND)]
wrong = sum(error != 0 for error in errors)
print(f"of the last 1,000 ns of a second, {wrong} come back wrong, by {set(errors) - {0}} ns")
assert 100 < wrong < 140 and set(errors) == {0, SECOND}
exact = Timestamp()
exact.FromNanoseconds(start + SECOND - 1)
assert exact.ToNanoseconds() == start + SECOND - 1

converter = RobotTimeConverter(5 * SECOND)
end = Timestamp(seconds=1_800_000_000, nanos=999_999_999)
moved = converter.robot_timestamp_from_local(end)
print(f"end {end.seconds}.{end.nanos} on a robot whose clock is 5 s ahead: {moved.seconds}.{moved.nanos}")
assert (moved.seconds, moved.nanos) == (1_800_000_006, 999_999_999)

before = nsec_to_timestamp(-SECOND // 2)
print("-0.5 s becomes", before.seconds, "s and", before.nanos, "ns")
assert (before.seconds, before.nanos) == (0, SECOND // 2)
PY
