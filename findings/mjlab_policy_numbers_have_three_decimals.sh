#!/usr/bin/env bash
# mjlab 1.6.0: the numbers that an exported policy carries are rounded to three decimals, whole numbers and flags too.
#
# The exporter writes joint defaults, gains, action scales, observation scales and history lengths into the ONNX file's
# metadata through list_to_csv_str. 0.0004 becomes "0.000", 0.05236 rad becomes "0.052", a history of 3 becomes "3.000"
# and True "1.000", so int() refuses it. A NumPy or PyTorch scalar is no int or float here and keeps all its digits.
# Whoever runs such a policy: read counts as float, and take small scales from the training config, not from the file.
#
# Only the function that formats is called. The modules that are imported beside it (torch, onnx and the simulator) are
# left empty, so that nothing of several gigabytes is installed.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet --no-deps "mjlab==1.6.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import importlib.util
import sys
from importlib.metadata import files, version
from unittest.mock import MagicMock

import numpy as np

assert version("mjlab") == "1.6.0"
for name in ("onnx", "torch", "mjlab", "mjlab.entity", "mjlab.envs", "mjlab.envs.mdp", "mjlab.envs.mdp.actions"):
    sys.modules[name] = MagicMock()
file = next(f for f in files("mjlab") if str(f) == "mjlab/rl/exporter_utils.py").locate()
spec = importlib.util.spec_from_file_location("exporter_utils", file)
exporter = importlib.util.module_from_spec(spec)
spec.loader.exec_module(exporter)
written = exporter.list_to_csv_str
for value in ([0.0004, 0.05236], [0, 3, True], [[-1.0, 1.0], 2.0], [np.float32(0.0004)]):
    print(value, "->", repr(written(value)))
assert written([0.0004, 0.05236]) == "0.000,0.052"
assert written([0, 3, True]) == "0.000,3.000,1.000"
assert written([[-1.0, 1.0], 2.0]) == "-1.000;1.000,2.000"
assert written([np.float32(0.0004)]) == "0.0004"
PY
