#!/usr/bin/env bash
# pybag-sdk 0.13.0 beside mcap 1.6.0: "filter" and "merge" number messages anew, so lost ones can no longer be seen.
#
# The sequence numbers of an MCAP channel tell a reader which messages a recorder lost. "pybag filter" and "merge" write
# 0, 1, 2, ... instead: a log that lost ten messages of fifty leaves them without a gap ("sort" and "recover" keep the
# numbers). A filter by time drops attachments that were stored before it, such as the policy that ran, and keeps the
# metadata. Its times are seconds since 1970: "--start-time 0.2 --end-time 0.4", as its README's examples look, gives a
# file without messages, and no error. Whoever cuts logs: count the losses before.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "pybag-sdk==0.13.0" "mcap==1.6.0"
cd "$folder"
venv/bin/python - <<'PY'
import json
import subprocess
from importlib.metadata import version

from mcap.reader import make_reader
from mcap.writer import Writer

assert version("pybag-sdk") == "0.13.0" and version("mcap") == "1.6.0"
BEGIN_NS = 1_700_000_000 * 10**9
LOST = range(20, 30)

with open("log.mcap", "wb") as file:
    writer = Writer(file)
    writer.start(profile="ros2", library="test")
    schema = writer.register_schema("State", "jsonschema", b'{"type": "object"}')
    channel = writer.register_channel("/state", "json", schema)
    writer.add_metadata("config", {"kp": "60"})
    writer.add_attachment(BEGIN_NS, BEGIN_NS, "policy.onnx", "application/octet-stream", b"weights")
    for number in range(50):
        if number not in LOST:
            time_ns = BEGIN_NS + number * 20_000_000
            writer.add_message(channel, time_ns, json.dumps({"number": number}).encode(), time_ns, number)
    writer.finish()


def read(path: str) -> tuple[list[int], list[int], int, int]:
    """Sequence numbers, the numbers in the messages, and how many attachments and metadata records there are."""
    with open(path, "rb") as file:
        reader = make_reader(file)
        messages = [(message.sequence, json.loads(message.data)["number"]) for _, _, message in reader.iter_messages()]
        parts = len([*reader.iter_attachments()]), len([*reader.iter_metadata()])
    return [told for told, _ in messages], [true for _, true in messages], *parts


def pybag(command: str, *arguments: str) -> tuple[list[int], list[int], int, int]:
    subprocess.run(["venv/bin/pybag", command, "log.mcap", *arguments, "-o", f"{command}.mcap"], check=True)
    return read(f"{command}.mcap")


kept = [number for number in range(50) if number not in LOST]
assert read("log.mcap") == (kept, kept, 1, 1)
for command, arguments in (("sort", ["--log-time"]), ("recover", []), ("filter", ["--include-topic", "/state"])):
    told, true, attachments, metadata = pybag(command, *arguments)
    print(f"{command}: numbers {told[0]} to {told[-1]}, truly {true[0]} to {true[-1]}")
    assert told == ([*range(40)] if command == "filter" else kept) and true == kept
    assert attachments == metadata == 1
told, true, *_ = pybag("merge", "sort.mcap")
print(f"merge of two: numbers {told[0]} to {told[-1]} for {len(told)} messages")
assert told == [*range(80)] and true != told



def cut(begin_s: str, end_s: str) -> tuple[list[int], list[int], int, int]:
    path = f"{begin_s}.mcap"
    command = ["venv/bin/pybag", "filter", "log.mcap", "--start-time", begin_s, "--end-time", end_s, "-o", path]
    subprocess.run(command, check=True)
    return read(path)


told, true, attachments, metadata = cut("1700000000.1", "1700000000.9")
print(f"from 0.1 to 0.9 s of it: {len(told)} messages, {attachments} attachments, {metadata} metadata records")
assert true == [number for number in kept if 5 <= number <= 45] and attachments == 0 and metadata == 1
told, *_ = cut("0.2", "0.4")
print(f"from 0.2 to 0.4 s: {len(told)} messages")
assert told == []
PY
