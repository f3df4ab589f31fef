"""docs/reference/log-schema.md: every field of the log's records."""

from __future__ import annotations

import re
from pathlib import Path

from spot_log.format.records import EventRecord, RunHeader
from spot_log.format.tables import ArmTable, CommandTable, ImuTable, SlowTable, StateTable, TickTable
from spot_log.read.run import RunFooter

from .words import attribute_docs, page, table

PROTO = Path(__file__).resolve().parents[2] / "protos" / "spot_protos" / "log.proto"
MESSAGE = re.compile(
    r"(?P<about>(?:^//[^\n]*\n)*)^message (?P<name>\w+) \{\n(?P<body>.*?)^\}", re.MULTILINE | re.DOTALL
)
FIELD = re.compile(r"^\s+(?P<type>(?:repeated |optional )?[\w.<>, ]+?) (?P<name>\w+) = \d+;\s*(?://\s*(?P<about>.*))?$")
SHAPE = re.compile(r"\s*Shape \([^)]*\)(?:, or \([^)]*\)[^.;]*)?[.;]?")
AS_READ: dict[str, type] = {
    "Header": RunHeader,
    "ImuPacket": ImuTable,
    "State": StateTable,
    "Arm": ArmTable,
    "Command": CommandTable,
    "Tick": TickTable,
    "SlowState": SlowTable,
    "Event": EventRecord,
    "Footer": RunFooter,
}
"""What a message becomes when it is read, whose fields have the same names."""
ABOUT = """\
A log is one MCAP file; each topic carries one protobuf message, whose schema is in the file, so any MCAP reader
decodes it. Arrays are in the order of the header's `joint_names` (Spot: fl, fr, hl, hr × hx, hy, kn) and
`foot_names`, SI units, quaternions scalar first. Stamps are nanoseconds of the clock in their name. An empty array
means that the source has no such signal.

In Python the same fields are arrays: `spot_rl.read_run(FILE).states.position_rad` ([Python](../python.md)); as
tables, `spot-rl log export` writes one column a joint. What the topics are for: [logs](../log.md)."""


def log_page() -> str:
    """The page."""
    parts = []
    for message in MESSAGE.finditer(PROTO.read_text(encoding="utf-8")):
        about = " ".join(line.removeprefix("//").strip() for line in message["about"].splitlines())
        read = attribute_docs(AS_READ[message["name"]])
        rows = [
            (f"`{field['name']}`", field["type"], field["about"] or SHAPE.sub("", read.get(field["name"], "")))
            for line in message["body"].splitlines()
            if (field := FIELD.match(line))
        ]
        parts.append(f"## {message['name']}\n\n{about}\n\n{table(('field', 'type', 'meaning'), rows)}")
    return page("Log schema", ABOUT, parts)
