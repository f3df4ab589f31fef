#!/usr/bin/env bash
# lcm 1.5.3: a loop over a log begins at its start, wherever it was sent; a seek lands within events of one time.
#
# EventLog.seek_to_timestamp() moves read_next_event(), but "for event in log" goes back to the first event, and each
# next(iter(log)) is the first one again. A seek to a time that 50 events share lands at the 26th of them, so 25 are
# passed over; between two times it lands at the earlier one. Whoever wants a part of a log: seek a little earlier,
# call read_next_event() until it returns None, and drop what is too early.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "lcm==1.5.3"
cd "$folder"
venv/bin/python - <<'PY'
from importlib.metadata import version

import lcm

assert version("lcm") == "1.5.3"


def written(times_us: list[int]) -> None:
    log = lcm.EventLog("log.lcm", "w", overwrite=True)
    for time_us in times_us:
        log.write_event(time_us, "STATE", b"x" * 40)
    log.close()


written(list(range(0, 1000, 10)))
log = lcm.EventLog("log.lcm", "r")
for asked, found in ((500, 500), (505, 500), (985, 980)):
    log.seek_to_timestamp(asked)
    event = log.read_next_event()
    print("asked for", asked, "found", event.timestamp)
    assert event.timestamp == found
log.seek_to_timestamp(500)
first = next(event.timestamp for event in log)
print("after a seek to 500 a loop begins at", first)
assert first == 0
assert [next(iter(log)).eventnum for _ in range(3)] == [0, 0, 0]

written([0] * 5 + [100] * 50 + [200] * 5)
log = lcm.EventLog("log.lcm", "r")
log.seek_to_timestamp(100)
event = log.read_next_event()
print("50 events at 100, the first of them is number 5; a seek lands at number", event.eventnum)
assert event.timestamp == 100 and event.eventnum == 30
rest = 1
while log.read_next_event() is not None:
    rest += 1
assert rest == 30
PY
