#!/usr/bin/env bash
# pin (Pinocchio) 4.1.0 beside mujoco 4.0.0: the same URDF has other joints first, and its damping acts in one of them.
#
# Pinocchio sorts a link's joints by name, MuJoCo keeps the file's order: with "right" before "left" in the file, q[0]
# is the left hip in one and the right one in the other. A continuous joint takes two numbers of q in Pinocchio, one in
# MuJoCo, and so moves all after it. Pinocchio reads damping and friction into model.damping and model.friction, but
# rnea and aba know neither: a joint that turns freely has no deceleration there.
# Whoever compares both: map joints by name through idx_q, and take model.damping * v from the torques by hand.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "pin==4.1.0" "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import mujoco
import numpy as np
import pinocchio


def leg(name, damping, kind="revolute"):
    """A link with an inertia of 0.1 kg m2, hinged to the trunk."""
    return f"""
    <link name="{name} leg"><inertial><mass value="1"/>
      <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
    <joint name="{name}" type="{kind}"><parent link="trunk"/><child link="{name} leg"/><axis xyz="1 0 0"/>
      <limit lower="-1" upper="1" effort="7" velocity="3"/><dynamics damping="{damping}" friction="0.3"/></joint>"""


assert pinocchio.__version__ == "4.1.0" and mujoco.__version__ == "4.0.0"
urdf = f'<robot name="biped"><link name="trunk"/>{leg("right", 0.5)}{leg("left", 0.2)}</robot>'
a, b = pinocchio.buildModelFromXML(urdf), mujoco.MjModel.from_xml_string(urdf)
names_a, names_b = list(a.names)[1:], [b.joint(i).name for i in range(b.njnt)]
print("joints:", names_a, "and", names_b)
assert names_a == ["left", "right"] and names_b == ["right", "left"]

turning, still = np.ones(2), np.zeros(2)
b.opt.gravity[:] = 0.0
b.dof_frictionloss[:] = 0.0  # damping alone is compared
data = mujoco.MjData(b)
data.qvel[:] = turning
mujoco.mj_forward(b, data)
slowed_a = pinocchio.aba(a, a.createData(), still, turning, still)
torque_a = pinocchio.rnea(a, a.createData(), still, turning, still)
print("acceleration while turning:", slowed_a, "and", data.qacc, "- damping read:", a.damping, "friction:", a.friction)
assert a.damping.tolist() == [0.2, 0.5] and a.friction.tolist() == [0.3, 0.3]
assert np.abs(slowed_a).max() < 1e-12 and np.abs(torque_a).max() < 1e-12
assert np.allclose(data.qacc, [-5.0, -2.0])

wheeled = urdf.replace("</robot>", leg("a wheel", 0.0, "continuous") + "</robot>")
a, b = pinocchio.buildModelFromXML(wheeled), mujoco.MjModel.from_xml_string(wheeled)
places_a = {name: a.joints[a.getJointId(name)].idx_q for name in list(a.names)[1:]}
places_b = {b.joint(i).name: int(b.jnt_qposadr[i]) for i in range(b.njnt)}
print("places in q with a wheel:", places_a, "of", a.nq, "and", places_b, "of", b.nq)
assert (places_a, a.nq) == ({"a wheel": 0, "left": 2, "right": 3}, 4)
assert (places_b, b.nq) == ({"right": 0, "left": 1, "a wheel": 2}, 3)
PY
