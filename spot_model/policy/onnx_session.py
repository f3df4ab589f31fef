"""A network in ONNX Runtime: how it is opened, and what shapes it must have."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import onnxruntime

from spot_model.policy.contract import INPUT_NAME, OUTPUT_NAME, PolicyError
from spot_model.robot import facts

PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider", "tensorrt": "TensorrtExecutionProvider"}
"""Where ONNX Runtime may compute, by the configuration's names."""


def open_session(data: bytes, source: str, provider: str) -> Any:
    """A session that computes on one thread. Raises PolicyError; ``source`` names the file."""
    wanted, there = PROVIDERS[provider], onnxruntime.get_available_providers()
    if wanted not in there:
        raise PolicyError(
            f"control.inference = {provider!r} needs ONNX Runtime's {wanted}, and this one has {', '.join(there)}; "
            "install a build of it that has the provider, or set 'cpu'"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 3
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    with words_for(source):
        return onnxruntime.InferenceSession(data, options, providers=[wanted])


@contextmanager
def words_for(source: str) -> Iterator[None]:
    """Our words for whatever onnxruntime raises: bare pybind exceptions of many types, and those of its texts."""
    try:
        yield
    except PolicyError:
        raise
    except Exception as error:
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise PolicyError(f"policy {source} is no readable ONNX model: {reason}; export it again") from error


def check_shapes(session: Any, source: str, width: int) -> None:
    """Refuse a network other than one float tensor (batch, ``width``) to one (batch, 12). Raises PolicyError."""
    for kind, nodes, name, size in (
        ("input", session.get_inputs(), INPUT_NAME, width),
        ("output", session.get_outputs(), OUTPUT_NAME, facts.N_JOINTS),
    ):
        found = [(n.name, list(n.shape), n.type) for n in nodes]
        ok = (
            len(nodes) == 1
            and nodes[0].name == name
            and len(nodes[0].shape) == 2
            and nodes[0].shape[1] == size
            and (nodes[0].shape[0] == 1 or not isinstance(nodes[0].shape[0], int))
            and nodes[0].type == "tensor(float)"
        )
        if not ok:
            raise PolicyError(
                f"policy {source}: {kind} is {found}; expected one float tensor '{name}' of shape (batch, {size})"
            )
