#!/usr/bin/env bash
# tract 0.23.9 beside onnxruntime 1.31.1: an observation that is not a number comes out as an action, and Celu differs.
#
# Clip, Relu, Max, Tanh and Sigmoid of a value that is not a number give their lowest value in tract on x86-64, and NaN
# in onnxruntime. So a policy that clips its observations first, or ends in Tanh, answers an IMU's NaN with plausible
# actions, and a check of the outputs sees nothing. (A Relu right behind Gemm, or Elu, lets NaN through.) Celu with
# alpha=0.5 gives exp(x / 0.5) - 1, without the factor 0.5 that ONNX has. Whoever changes the engine: check the
# observations before the policy, and compare outputs on recorded ones.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "tract==0.23.9" "onnx==1.22.0" "onnxruntime==1.31.1" "numpy==2.4.6"
cd "$folder"
venv/bin/python - <<'PY'
from importlib.metadata import version

import numpy as np
import onnx
import onnxruntime
import tract
from onnx import TensorProto, helper, numpy_helper

assert version("tract") == "0.23.9" and onnxruntime.__version__ == "1.31.1"


def answers(nodes: list, observation: np.ndarray, **constants: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What onnxruntime and tract make of an observation."""
    shapes = [helper.make_tensor_value_info(name, TensorProto.FLOAT, observation.shape) for name in ("x", "y")]
    weights = [numpy_helper.from_array(np.asarray(value, np.float32), name) for name, value in constants.items()]
    graph = helper.make_graph(nodes, "policy", shapes[:1], shapes[1:], weights)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    onnx.checker.check_model(model)
    onnx.save(model, "policy.onnx")
    theirs = onnxruntime.InferenceSession("policy.onnx").run(None, {"x": observation})[0]
    return theirs, tract.onnx().load("policy.onnx").into_model().into_runnable().run([observation])[0].to_numpy()


broken = np.array([[np.nan, -3.0, 3.0]], np.float32)
limits = {"least": -1.0, "most": 1.0}
for name, inputs, constants, lowest in (
    ("Clip", ["x", "least", "most"], limits, -1.0),
    ("Relu", ["x"], {}, 0.0),
    ("Max", ["x", "least"], {"least": 0.0}, 0.0),
    ("Tanh", ["x"], {}, -1.0),
    ("Sigmoid", ["x"], {}, 0.0),
):
    usual, other = answers([helper.make_node(name, inputs, ["y"])], broken, **constants)
    print(f"{name} of {broken[0]}: onnxruntime {usual[0]}, tract {other[0]}")
    assert np.isnan(usual[0, 0]) and abs(other[0, 0] - lowest) < 1e-5
    assert np.allclose(usual[0, 1:], other[0, 1:], atol=1e-5)

rng = np.random.default_rng(0)
weights = {"w": rng.normal(size=(3, 3)), "b": rng.normal(size=(1, 3))}
for name, layers, constants, passes in (
    ("Clip, Gemm", [("Clip", "x", "least", "most", "c"), ("Gemm", "c", "w", "b", "y")], limits, False),
    ("Gemm, Tanh", [("Gemm", "x", "w", "b", "h"), ("Tanh", "h", "y")], {}, False),
    ("Gemm, Relu", [("Gemm", "x", "w", "b", "h"), ("Relu", "h", "y")], {}, True),
    ("Gemm, Elu", [("Gemm", "x", "w", "b", "h"), ("Elu", "h", "y")], {}, True),
):
    nodes = [helper.make_node(kind, wires[:-1], wires[-1:]) for kind, *wires in layers]
    usual, other = answers(nodes, broken, **weights, **constants)
    print(f"a policy of {name}: onnxruntime {usual[0]}, tract {other[0]}")
    assert np.isnan(usual).all() and (np.isnan(other) if passes else np.isfinite(other)).all()
    usual, other = answers(nodes, np.ones((1, 3), np.float32), **weights, **constants)
    assert np.allclose(usual, other, atol=1e-5)

usual, other = answers([helper.make_node("Celu", ["x"], ["y"], alpha=0.5)], np.array([[-2.5, -0.5, 1.0]], np.float32))
print(f"Celu with alpha 0.5: onnxruntime {usual[0]}, tract {other[0]}")
assert np.allclose(other[0, :2], 2.0 * usual[0, :2], rtol=1e-4) and other[0, 2] == usual[0, 2]
PY
