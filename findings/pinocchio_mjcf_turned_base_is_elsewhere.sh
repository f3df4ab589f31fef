#!/usr/bin/env bash
# pin (Pinocchio) 4.1.0 beside mujoco 4.0.0: a floating base whose body is placed and turned in MJCF is metres away.
#
# The place and the turn of a body with a free joint are its first configuration, and nothing else: in MuJoCo qpos 0 is
# the world's origin. Pinocchio takes both out of the joint's placement in the wrong order, so that p - R p is left in
# it: a robot at (1, 2, 3), turned by 90 degrees about x, stands 5 m to the left and 1 m up for the same configuration.
# Without a turn, or at the origin, both agree, which is why most models do. The reference configuration qpos0 is read
# rightly, so both disagree there, too. Whoever loads MJCF: compare the base's place at qpos0, or set jointPlacements[1]
# to the identity.
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
file = Path(sys.argv[1]) / "robot.xml"


def places(attributes):
    """Where the base is at qpos0 in MuJoCo and in Pinocchio, and Pinocchio's model."""
    base = f'<body name="base" {attributes}><freejoint name="root"/><geom size="0.1" mass="1"/></body>'
    file.write_text(f"<mujoco><worldbody>{base}</worldbody></mujoco>")
    a, b = pinocchio.buildModelFromMJCF(str(file)), mujoco.MjModel.from_xml_path(str(file))
    there = mujoco.MjData(b)
    mujoco.mj_kinematics(b, there)
    q = b.qpos0.copy()
    q[3:7] = np.roll(q[3:7], -1)  # MuJoCo: w first; Pinocchio: w last
    assert np.allclose([entry.data() for entry in a.referenceConfigurations][0], q)
    here = a.createData()
    pinocchio.framesForwardKinematics(a, here, q)
    return there.xpos[1].copy(), here.oMf[a.getFrameId("base", pinocchio.BODY)].translation.copy(), a


for attributes in ('pos="1 2 3"', 'quat="1 1 0 0"'):
    there, here, _ = places(attributes)
    print(f"{attributes}: MuJoCo {there}, Pinocchio {here}")
    assert np.allclose(there, here)
there, here, model = places('pos="1 2 3" quat="1 1 0 0"')
place, quarter = np.array([1.0, 2.0, 3.0]), np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
print(f'pos="1 2 3" quat="1 1 0 0": MuJoCo {there}, Pinocchio {here}')
assert np.allclose(there, place) and np.allclose(model.jointPlacements[1].translation, place - quarter @ place)
assert np.allclose(here, [1.0, 7.0, 4.0])
model.jointPlacements[1] = pinocchio.SE3.Identity()
mended = model.createData()
pinocchio.framesForwardKinematics(model, mended, [entry.data() for entry in model.referenceConfigurations][0])
assert np.allclose(mended.oMf[model.getFrameId("base", pinocchio.BODY)].translation, place)
PY
