#!/usr/bin/env bash
# pin (Pinocchio) 4.1.0 beside mujoco 4.0.0: turns, limits and masses of the same MJCF differ, without a word.
#
# In Pinocchio's reader the orders XYZ and ZYX of eulerseq turn in another way; an axisangle whose axis is not of length
# one gives a matrix that is no rotation; ref moves a joint's limits, though not the joint; limited="false" keeps the
# limits; settotalmass and boundmass of the compiler are passed over. Each lets the model load and look almost right.
# Whoever takes a model from MuJoCo to Pinocchio: compile it, write it back with mj_saveLastXML, which resolves turns
# and the total mass, but not ref, limited and boundmass, and compare mass, limits and places.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "pin==4.1.0" "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - "$folder" <<'PY'
import sys
from pathlib import Path

import mujoco
import numpy as np
import pinocchio

assert pinocchio.__version__ == "4.1.0" and mujoco.__version__ == "4.0.0"
file = Path(sys.argv[1]) / "leg.xml"


def both(compiler="", knee="", leg=""):
    """The same leg in MuJoCo and in Pinocchio: turn of the lower leg, limits of the knee, mass."""
    file.write_text(f"""<mujoco><compiler angle="radian" {compiler}/><worldbody>
      <body name="upper"><joint name="hip" axis="1 0 0"/><geom size="0.1" mass="1"/>
        <body name="lower" pos="0 0 -0.3" {leg}><joint name="knee" axis="0 1 0" range="-1 1" {knee}/>
          <geom size="0.05" pos="0 0 -0.2" mass="1"/></body></body></worldbody></mujoco>""")
    a, b = pinocchio.buildModelFromMJCF(str(file)), mujoco.MjModel.from_xml_path(str(file))
    here, there = a.createData(), mujoco.MjData(b)
    pinocchio.framesForwardKinematics(a, here, np.zeros(2))
    there.qpos[:] = 0.0  # with ref, qpos0 is not zero
    mujoco.mj_kinematics(b, there)
    turn = here.oMf[a.getFrameId("lower", pinocchio.BODY)].rotation
    limits_b = b.jnt_range[1].tolist() if b.jnt_limited[1] else [-np.inf, np.inf]
    limits_a = [a.lowerPositionLimit[1], a.upperPositionLimit[1]]
    return (turn, there.xmat[2].reshape(3, 3)), (limits_a, limits_b), (pinocchio.computeTotalMass(a), b.body_mass.sum())


turns, limits, masses = both(leg='euler="0.1 0.2 0.3"')
assert np.allclose(*turns) and np.allclose(*limits) and np.isclose(*masses)

for order in ("XYZ", "ZYX"):
    turns, _, _ = both(f'eulerseq="{order}"', leg='euler="0.1 0.2 0.3"')
    print(f"eulerseq {order}: entries of the rotation differ by up to {np.abs(turns[0] - turns[1]).max():.3f}")
    assert not np.allclose(*turns, atol=0.05)
turns, _, _ = both(leg='axisangle="0 1 1 0.3"')
print(f"axisangle about (0, 1, 1): Pinocchio's columns have lengths {np.linalg.norm(turns[0], axis=0).round(3)}")
assert not np.allclose(*turns, atol=0.05)
turns, limits, _ = both(knee='ref="0.4"')
print("limits with ref 0.4:", *limits)
assert np.allclose(limits[0], [-1.4, 0.6]) and limits[1] == [-1.0, 1.0]
_, limits, _ = both(knee='limited="false"')
print("limits of a joint that has none:", *limits)
assert np.allclose(limits[0], [-1.0, 1.0]) and limits[1] == [-np.inf, np.inf]
for compiler, total in (('settotalmass="7"', 7.0), ('boundmass="3"', 6.0)):
    _, _, masses = both(compiler)
    print(f"{compiler}: {masses[0]:.1f} kg and {masses[1]:.1f} kg")
    assert np.allclose(masses, [2.0, total])
PY
