"""The same network with other gains in its contract: one short log at them tells damping from viscous friction."""

from __future__ import annotations

from pathlib import Path

from spot_model.io.whole import whole_file
from spot_model.policy.contract import METADATA_KEY, PolicyContract
from spot_model.policy.policy import load_policy
from spot_model.robot import facts


def write_gain_variant(policy: Path, path: Path, kp_nm_per_rad: float, kd_nm_s_per_rad: float) -> Path:
    """Write a copy of a policy file with other gains in its contract; a file that is there already is kept.

    Raises:
        PolicyError: ``policy`` is not valid.
    """
    # Only this needs the extra 'train'; a collection without other gains does not.
    import onnx

    contract = load_policy(policy).contract
    changed = contract.model_copy(
        update={
            "name": f"{contract.name}-kp{kp_nm_per_rad:g}-kd{kd_nm_s_per_rad:g}",
            "kp_nm_per_rad": (kp_nm_per_rad,) * facts.N_JOINTS,
            "kd_nm_s_per_rad": (kd_nm_s_per_rad,) * facts.N_JOINTS,
        }
    )
    if path.exists():
        return path
    model = onnx.load(policy)
    for entry in model.metadata_props:
        if entry.key == METADATA_KEY:
            entry.value = PolicyContract.model_validate(changed.model_dump(by_alias=True)).to_json()
    with whole_file(path) as part:
        onnx.save(model, part)
    return path
