"""Put a recording of others where its mapping looks for it: `data/` beside this file. Sources: README.md.

    git clone https://github.com/iit-DLSLab/simple-robot-identification-isaaclab
    python examples/recordings/fetch.py go2 simple-robot-identification-isaaclab

Recordings become NPZ files, models lose meshes, contact geometry, free joints, and their authors' own friction and
rotors. Archives of torch are read as plain tensors: nothing in them is run.
"""

import argparse
import shutil
from pathlib import Path

DATA = Path(__file__).parent / "data"


def chirps(checkout: Path, name: str) -> None:
    """Tensors of one of the chirps, and its robot's bodies; the Z1's gripper stood still, and is left out."""
    import numpy as np
    import torch

    numpy_parts = [np._core.multiarray._reconstruct, np.ndarray, np.dtype, type(np.dtype("f8")), type(np.dtype("f4"))]
    with torch.serialization.safe_globals(numpy_parts):
        tensors = torch.load(checkout / "datasets" / name / "traj_0.pt", map_location="cpu", weights_only=True)
    arrays = {key: np.asarray(value) for key, value in tensors.items()}
    if name == "z1":
        arrays = {key: a[..., :6] if a.shape[-1] == 7 else a for key, a in arrays.items()}
    np.savez(DATA / f"{name}.npz", **arrays)
    without = ("jointGripper",) if name == "z1" else ()
    (DATA / f"{name}.xml").write_text(bare((checkout / "robot_model" / name / f"{name}.xml").read_text(), without))


def bare(mjcf: str, without: tuple[str, ...] = ()) -> str:
    """Bodies and hinges of an MJCF alone."""
    import mujoco

    spec = mujoco.MjSpec.from_string(mjcf)
    kinds = ("geoms", "meshes", "materials", "textures", "keys", "sensors", "sites", "cameras", "lights", "actuators")
    for part in [part for kind in kinds for part in getattr(spec, kind)]:
        spec.delete(part)
    for joint in list(spec.joints):
        if joint.type == mujoco.mjtJoint.mjJNT_FREE or joint.name in without:
            spec.delete(joint)
        else:
            joint.armature, joint.frictionloss, joint.damping = 0.0, 0.0, [0.0] * 3
    spec.compile()
    return spec.to_xml()


def pendulum(checkout: Path, name: str) -> None:
    """Measured and desired, under the names that the mapping has."""
    (folder,) = checkout.rglob("control_method_energy_shaping") or [checkout]
    (DATA / name).mkdir(exist_ok=True)
    for kind in ("measured", "desired"):
        ending = "_1kg" if name.endswith("1kg") else ""
        shutil.copy(folder / f"data_{kind}{ending}.csv", DATA / name / f"data_{kind}.csv")


def franka(checkout: Path, name: str) -> None:
    """The file as it is."""
    shutil.copy(checkout / "Comparative data" / "Franka Robot" / "case3_slow.csv", DATA / f"{name}.csv")


RECORDINGS = {
    "go2": chirps,
    "aliengo": chirps,
    "z1": chirps,
    "pendulum": pendulum,
    "pendulum_1kg": pendulum,
    "franka_joint2": franka,
}

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("name", choices=RECORDINGS)
    parser.add_argument("checkout", type=Path, help="the source's repository, cloned")
    chosen = parser.parse_args()
    DATA.mkdir(exist_ok=True)
    RECORDINGS[chosen.name](chosen.checkout, chosen.name)
    print(f"{chosen.name}: written into {DATA}")
