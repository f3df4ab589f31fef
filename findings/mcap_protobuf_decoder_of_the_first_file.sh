#!/usr/bin/env bash
# mcap-protobuf-support 0.6.0: one DecoderFactory for several files decodes the second with the first one's types.
#
# It remembers a message's class by the number that the schema has in its file, and each file counts from 1. Given to
# the readers of two files, it parses a Duration as the Timestamp of the file before, without an error since the wire
# formats fit, and a DoubleValue as a Timestamp with no field set: its number is lost.
# Whoever reads several logs: a new DecoderFactory for each file.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mcap-protobuf-support==0.6.0" "mcap==1.6.0" "protobuf==7.36.2"
"$folder/venv/bin/python" - <<'PY'
import io
from importlib.metadata import version

from google.protobuf.duration_pb2 import Duration
from google.protobuf.timestamp_pb2 import Timestamp
from google.protobuf.wrappers_pb2 import DoubleValue
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from mcap_protobuf.writer import Writer

assert version("mcap-protobuf-support") == "0.6.0"


def file_of(message):
    """An MCAP file with this message."""
    file = io.BytesIO()
    with Writer(file) as writer:
        writer.write_message("/told", message, log_time=1, publish_time=1)
    file.seek(0)
    return file


def read(message, factory):
    """The schema's name and the decoded message."""
    schema, _, _, decoded = next(make_reader(file_of(message), decoder_factories=[factory]).iter_decoded_messages())
    return schema.name, decoded


shared = DecoderFactory()
read(Timestamp(seconds=5), shared)
for message in (Duration(seconds=7, nanos=3), DoubleValue(value=1.5)):
    name, decoded = read(message, shared)
    fields = {field.name: value for field, value in decoded.ListFields()}
    print(f"{name} is read as {type(decoded).DESCRIPTOR.full_name} with {fields}")
    assert name == type(message).DESCRIPTOR.full_name
    assert type(decoded).DESCRIPTOR.full_name == "google.protobuf.Timestamp"
    own = read(message, DecoderFactory())[1]
    assert type(own).DESCRIPTOR.full_name == name and own.SerializeToString() == message.SerializeToString()
assert fields == {}
PY
