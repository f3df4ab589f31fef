#!/usr/bin/env bash
# onnxruntime 1.31.1: an input array in the other byte order is taken, and its bytes are read as they lie.
#
# The session compares the type of an array with that of the input and refuses float64 or float16 where float32 is due.
# NumPy's ">f4" passes, since it counts as float32, without a swap: 1.0 becomes 4.6e-41. OrtValue does the same.
# Such arrays come from numpy.frombuffer on data in network order or from HDF5 files, and stay so when sliced.
# Whoever feeds a policy from a recording: np.asarray(observation, np.float32) swaps, and costs nothing otherwise.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "onnxruntime==1.31.1" "onnx==1.23.2" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import numpy as np
import onnx
import onnxruntime
from onnx import TensorProto, helper

assert onnxruntime.__version__ == "1.31.1"
graph = helper.make_graph(
    [helper.make_node("Mul", ["x", "x"], ["y"])],
    "square",
    [helper.make_tensor_value_info("x", TensorProto.FLOAT, ["n"])],
    [helper.make_tensor_value_info("y", TensorProto.FLOAT, ["n"])],
)
network = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
onnx.checker.check_model(network)
session = onnxruntime.InferenceSession(network.SerializeToString(), providers=["CPUExecutionProvider"])


def squares(values):
    return session.run(None, {"x": values})[0]


received = np.frombuffer(bytes.fromhex("3f800000" "40000000" "c0400000"), ">f4")  # 1, 2 and -3 in network order
print(received, "squared:", squares(received), "- with asarray first:", squares(np.asarray(received, np.float32)))
assert received.tolist() == [1.0, 2.0, -3.0] and received.dtype == np.dtype(">f4")
assert np.array_equal(squares(np.asarray(received, np.float32)), [1.0, 4.0, 9.0])
assert not np.allclose(squares(received), [1.0, 4.0, 9.0])
held = onnxruntime.OrtValue.ortvalue_from_numpy(received).numpy()
print("as an OrtValue:", held)
assert np.array_equal(held.view("<u4"), received.view("<u4"))
try:
    squares(received.astype(np.float64))
except Exception as error:
    print("float64:", str(error).splitlines()[0])
else:
    raise AssertionError("float64 was taken")
PY
