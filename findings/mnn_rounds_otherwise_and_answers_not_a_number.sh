#!/usr/bin/env bash
# MNN 3.6.1 and openvino 2026.4.1 beside onnxruntime 1.31.1: half a step is rounded otherwise, and NaN gets an answer.
#
# Of the same ONNX files on x86-64, MNN rounds 0.5, 1.5 and 2.5 to 1, 2 and 3, where ONNX rounds to the even number, and
# takes the approximation of Gelu by tanh where the file asks for none (4e-4 off). A value that is not a number becomes
# 1 behind its Clip and Tanh and -1 behind Elu; a Gemm makes all its outputs -3.4e38 of it. OpenVINO's Clip gives -1 and
# its Relu 0, while Tanh and Gemm keep it. onnxruntime keeps it in all. A check of a policy's outputs that works with
# one engine sees nothing with another. Whoever changes the engine: check observations before the policy.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "MNN==3.6.1" "openvino==2026.4.1" "onnxruntime==1.31.1" "onnx==1.22.0" \
    "numpy==2.4.6"
cd "$folder"
venv/bin/python - <<'PY'
import subprocess
from importlib.metadata import version

import MNN.expr
import MNN.nn
import numpy as np
import onnx
import onnxruntime
import openvino
from onnx import TensorProto, helper, numpy_helper

assert version("MNN") == "3.6.1" and version("openvino").startswith("2026.4.1")
assert onnxruntime.__version__ == "1.31.1"
CONVERT = "venv/bin/mnnconvert -f ONNX --modelFile net.onnx --MNNModel net.mnn --bizCode net".split()
CONSTANTS = {"least": -1.0, "most": 1.0, "weights": np.eye(3)}


def outputs(kind: str, values: list[float], *more: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What onnxruntime, OpenVINO and MNN make of a network of one operation."""
    x = np.array([values], np.float32)
    shapes = [helper.make_tensor_value_info(name, TensorProto.FLOAT, x.shape) for name in ("x", "y")]
    constants = [numpy_helper.from_array(np.asarray(CONSTANTS[name], np.float32), name) for name in more]
    graph = helper.make_graph([helper.make_node(kind, ["x", *more], ["y"])], "net", shapes[:1], shapes[1:], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 20)], ir_version=10)
    onnx.checker.check_model(model)
    onnx.save(model, "net.onnx")
    usual = onnxruntime.InferenceSession("net.onnx").run(None, {"x": x})[0][0]
    second = openvino.Core().compile_model("net.onnx", "CPU")([x])[0][0]
    subprocess.run(CONVERT, check=True, capture_output=True)
    network = MNN.nn.load_module_from_file("net.mnn", ["x"], ["y"])
    given = MNN.expr.placeholder(list(x.shape), MNN.expr.NCHW, MNN.expr.float)
    given.write(x.ravel().tolist())
    third = np.array(MNN.expr.convert(network.forward([given])[0], MNN.expr.NCHW).read()).reshape(-1)
    for name, found in (("onnxruntime", usual), ("openvino", second), ("MNN", third)):
        print(f"{kind} of {values}: {name} {found}")
    return usual, second, third


usual, second, third = outputs("Round", [0.5, 1.5, 2.5])
assert usual.tolist() == second.tolist() == [0.0, 2.0, 2.0] and third.tolist() == [1.0, 2.0, 3.0]
usual, second, third = outputs("Gelu", [-2.5, -1.5, 1.5])
assert np.allclose(usual, second, atol=1e-6) and 2e-4 < np.abs(third - usual).max() < 1e-3

nan = float("nan")
for kind, more, of_openvino, of_mnn in (
    ("Clip", ["least", "most"], -1.0, 1.0),
    ("Relu", [], 0.0, None),
    ("Tanh", [], nan, 1.0),
    ("Elu", [], nan, -1.0),
    ("Gemm", ["weights"], nan, float(np.finfo(np.float32).min)),
):
    usual, second, third = outputs(kind, [nan, 0.5, -0.5], *more)
    assert np.isnan(usual[0]) and np.array_equal(second[0], np.float32(of_openvino), equal_nan=True)
    assert of_mnn is None or np.isclose(third[0], of_mnn)
    assert kind == "Gemm" or np.allclose(third[1:], usual[1:], atol=1e-5)
assert (third == np.finfo(np.float32).min).all()
PY
