"""From a checkpoint to an ONNX file that describes itself, its gait included."""

from __future__ import annotations

from pathlib import Path

from spot_model.errors import BadInputError
from spot_model.io.model_file import load_model
from spot_model.io.whole import whole
from spot_model.policy.policy import policy_from_bytes
from trainer.evaluate.stated_gait import stated_gaits
from trainer.ppo.checkpoint import find_checkpoint
from trainer.ppo.checkpoint_policy import check_agreement, onnx_bytes, read_actor


def export_policy(run: Path, out: Path, name: str | None = None) -> Path:
    """Write the newest checkpoint's actor as ONNX with its contract; refuses to overwrite.

    Args:
        run: A run folder, or a checkpoint.
        out: The file to write.
        name: Name in the contract; the config's by default.

    Raises:
        BadInputError: There is no checkpoint, ``out`` exists, or the networks disagree by more than 1e-5.
    """
    if out.exists():
        raise BadInputError(f"policy file {out} exists; choose another name")
    config, layers, contract = read_actor(find_checkpoint(run), name)
    measured = stated_gaits(policy_from_bytes(onnx_bytes(layers, contract), source="export"), load_model(config.model))
    data = onnx_bytes(layers, contract.model_copy(update={"gait": measured}))
    check_agreement(layers, data)
    with whole(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        out.write_bytes(data)
    return out
