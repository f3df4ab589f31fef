#!/usr/bin/env bash
# python-can 4.6.1: what is left of a recording depends on the file's ending; CSV and SQLite make old frames of CAN FD.
#
# The same three messages through can.Logger and back through can.LogReader: in .csv and .db a CAN FD frame comes back
# as a classic one, of 64 bytes, which cannot be sent; received and sent frames are all "received", and the channel is
# gone, all without a word. candump's .log forgets how many bytes a remote frame asks for, .trc leaves CAN FD and remote
# frames out with a warning of the logger, counts channels from one, and gives later times where the first frame was
# left out. An .asc begins its time at zero where the reader is not told otherwise. .blf keeps all of these. Whoever
# replays what a drive sent: record .blf, or .asc and read it with relative_timestamp=False.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "python-can==4.6.1"
"$folder/venv/bin/python" - "$folder" <<'PY'
import sys
from pathlib import Path

import can

assert can.__version__ == "4.6.1"
START = 1_700_000_000.0
sent = [
    can.Message(START, 0x10, is_extended_id=False, is_fd=True, data=bytes(64), is_rx=False, channel=2),
    can.Message(START + 0.5, 0x11, is_extended_id=False, is_remote_frame=True, dlc=4, channel=2),
    can.Message(START + 1.0, 0x12, is_extended_id=False, data=b"\x01", channel=2),
]


def through(ending):
    """The messages that come back, by identifier."""
    path = Path(sys.argv[1]) / f"drive.{ending}"
    with can.Logger(path) as log:
        for message in sent:
            log.on_message_received(message)
    with can.LogReader(path) as log:
        back = {message.arbitration_id: message for message in log}
    for m in back.values():
        what = f"fd {m.is_fd} rx {m.is_rx} channel {m.channel} dlc {m.dlc} at {m.timestamp}"
        print(f"{ending}: {m.arbitration_id:x} {what}")
    return back


for ending in ("csv", "db"):
    frame = through(ending)[0x10]
    assert not frame.is_fd and len(frame.data) == 64 and frame.is_rx and frame.channel is None
blf, asc, candump, trc = through("blf"), through("asc"), through("log"), through("trc")
assert blf[0x10].is_fd and not blf[0x10].is_rx and blf[0x11].dlc == 4 and blf[0x12].timestamp == START + 1.0
assert asc[0x10].is_fd and asc[0x11].dlc == 4 and asc[0x12].timestamp == 1.0
assert candump[0x10].is_fd and candump[0x11].is_remote_frame and candump[0x11].dlc == 0
assert list(trc) == [0x12] and trc[0x12].channel == 3 and trc[0x12].timestamp == START + 2.0
PY
