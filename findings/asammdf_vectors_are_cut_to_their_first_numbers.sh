#!/usr/bin/env bash
# asammdf 8.8.28: a signal of vectors is stored as one of single numbers, which are those of its first few vectors.
#
# A Signal takes samples of any shape, and MDF.append says nothing to an array of N rows and 3 columns. What is read is
# the flattened array's first N numbers, one a time stamp: after 0, 1, 2 come the next row's 3 and 4, so the numbers are
# wrong from the second row on, for the first column, too, and two thirds of the recording are gone. The documentation
# asks for a NumPy record array for such signals, in a sentence of append; that one comes back whole. Whoever stores
# joints: one Signal for each, or a record array.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "asammdf==8.8.28" "numpy==2.4.6"
"$folder/venv/bin/python" - "$folder" <<'PY'
import sys
from pathlib import Path

import asammdf
import numpy as np
from asammdf import MDF, Signal

assert asammdf.__version__ == "8.8.28"
file = Path(sys.argv[1]) / "leg.mf4"
stamps = np.arange(5) * 0.1
angles = np.arange(15.0).reshape(5, 3)  # hip, thigh, knee; row k holds 3 k, 3 k + 1, 3 k + 2


def through(samples):
    """The samples of a signal that was written to a file and read back."""
    with MDF() as log:
        log.append([Signal(samples=samples, timestamps=stamps, name="leg")])
        log.save(file, overwrite=True)
    with MDF(file) as log:
        return log.get("leg")


back = through(angles)
print("sent rows", angles[:2].tolist(), "… read", back.samples.tolist(), "at", back.timestamps.tolist())
assert back.samples.shape == (5,) and back.samples.tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
assert np.allclose(back.timestamps, stamps)
assert not np.allclose(back.samples, angles[:, 0])

records = np.rec.fromarrays([angles], dtype=np.dtype([("leg", "f8", (3,))]))
whole = through(records).samples["leg"]
print("as a record array:", whole[:2].tolist(), "…")
assert np.array_equal(whole, angles)
PY
