#!/usr/bin/env bash
# bosdyn-core 5.2.0: numbers in a BDDF file share one time per block, and vectors can be neither written nor read.
#
# PodSeriesWriter.write takes a time with each sample, but keeps only that of a block's first: 256 doubles share one
# stamp, and the reader gives back that one. A series of dimension [3], which the format describes, cannot be written:
# the sample reaches struct.pack as one argument, whether it is a list, a tuple or an array. Written as bytes, it is in
# the file, but PodSeriesReader raises, since it takes itertools.product for the product of the dimensions.
# Whoever logs joints this way: one series per joint, with a block for each sample (data_block_size=8 for doubles).
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "bosdyn-core==5.2.0" "bosdyn-api==5.2.0" "protobuf==7.36.2" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import io
import struct
from importlib.metadata import version

import numpy as np
from bosdyn.api.bddf_pb2 import TYPE_FLOAT64
from bosdyn.bddf import DataReader, DataWriter, PodSeriesReader, PodSeriesWriter

assert version("bosdyn-core") == "5.2.0"
STAMPS = [1_800_000_000_000_000_000 + 3_000_000 * k for k in range(600)]
NAME = {"signal": "knee"}


class File(io.BytesIO):
    """Bytes that outlive the writer, which closes what it wrote to."""

    def close(self):
        self.held = self.getvalue()


def blocks(dimension, write, **options):
    """The times and samples of all blocks of a file that was written so."""
    file = File()
    with DataWriter(file) as data:
        write(data, PodSeriesWriter(data, "numbers", NAME, TYPE_FLOAT64, dimensions=dimension, **options))
    reader = PodSeriesReader(DataReader(io.BytesIO(file.held)), NAME)
    return [reader.read_samples(i) for i in range(reader.num_data_blocks)]


def write_scalars(data, series):
    for stamp in STAMPS:
        series.write(stamp, 0.5)


read = blocks(None, write_scalars)
print(f"{len(STAMPS)} samples come back as blocks of {[len(samples) for _, samples in read]}, each with one time")
assert [len(samples) for _, samples in read] == [256, 256, 88]
assert [stamp for stamp, _ in read] == STAMPS[::256]
assert [stamp for stamp, _ in blocks(None, write_scalars, data_block_size=8)] == STAMPS

for vector in ([1.0, 2.0, 3.0], (1.0, 2.0, 3.0), np.arange(3.0)):
    try:
        blocks([3], lambda data, series, vector=vector: series.write(STAMPS[0], vector))
    except struct.error as error:
        print(f"a vector as {type(vector).__name__}: {error}")
    else:
        raise AssertionError("a vector was written")
packed = struct.pack("<3d", 1.0, 2.0, 3.0)
try:
    blocks([3], lambda data, series: data.write_data(0, STAMPS[0], packed))
except TypeError as error:
    print(f"a vector in the file: {error}")
else:
    raise AssertionError("a vector was read")
PY
