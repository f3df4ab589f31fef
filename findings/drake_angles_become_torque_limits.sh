#!/usr/bin/env bash
# drake 1.51.1 beside mujoco 4.0.0: a position actuator's range of angles limits its torque, and a gear does not gear.
#
# Drake's parser takes an MJCF actuator's ctrlrange for its effort limit, in N m. Of a position actuator it is a range
# of angles: a drive that may be sent -1.5 to 1.5 rad gives at most 1.5 N m, though its forcerange is 40 N m. An arm of
# 2 kg that MuJoCo holds level to within 0.05 rad sags by 1.3 rad in Drake. Without ctrlrange both hold it. A motor's
# gear does not scale its torque: a command of 2 with gear="3" is 6 N m in MuJoCo and 2 N m in Drake. Drake prints a
# warning for none of these. Whoever loads a robot: compare effort_limit() of each actuator, and the torques.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "drake==1.51.1" "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import mujoco
import numpy as np
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.systems.analysis import Simulator

assert version("drake") == "1.51.1" and mujoco.__version__ == "4.0.0"
ARM = """<mujoco model="arm"><worldbody><body>
  <joint name="j" axis="0 1 0" damping="0.1" armature="0.01"/>
  <geom type="sphere" pos="0.5 0 0" size="0.05" mass="2" contype="0" conaffinity="0"/>
</body></worldbody><actuator>{}</actuator></mujoco>"""


def in_mujoco(actuator: str, command: float, end_s: float) -> tuple[float, float]:
    """The angle in rad and the drive's torque in N m at the end."""
    model = mujoco.MjModel.from_xml_string(ARM.format(actuator))
    model.opt.timestep = 0.001
    data = mujoco.MjData(model)
    data.ctrl[0] = command
    while data.time < end_s:
        mujoco.mj_step(model, data)
    return float(data.qpos[0]), float(data.qfrc_actuator[0])


def in_drake(actuator: str, command: float, end_s: float) -> tuple[float, float, float]:
    """The same, and the limit of the torque."""
    plant = MultibodyPlant(0.001)
    Parser(plant).AddModelsFromString(ARM.format(actuator), "xml")
    plant.Finalize()
    drive = plant.get_joint_actuator(plant.GetJointActuatorIndices()[0])
    robot = drive.model_instance()
    simulator = Simulator(plant)
    context = simulator.get_mutable_context()
    if drive.has_controller():
        plant.get_desired_state_input_port(robot).FixValue(context, [command, 0.0])
    else:
        plant.get_actuation_input_port(robot).FixValue(context, [command])
    simulator.AdvanceTo(end_s)
    torque = plant.get_net_actuation_output_port(robot).Eval(context)[0]
    return float(plant.GetPositions(context)[0]), float(torque), float(drive.effort_limit())


def compare(name: str, actuator: str, command: float, end_s: float) -> tuple[tuple[float, ...], tuple[float, ...]]:
    ours, theirs = in_mujoco(actuator, command, end_s), in_drake(actuator, command, end_s)
    print(f"{name}: MuJoCo {ours[0]:.2f} rad, {ours[1]:.2f} N m; ", end="")
    print(f"Drake {theirs[0]:.2f} rad, {theirs[1]:.2f} N m, effort limit {theirs[2]:.1f} N m")
    return ours, theirs


drive = '<position joint="j" kp="200" kv="5" {} forcelimited="true" forcerange="-40 40"/>'
ours, theirs = compare("forcerange alone", drive.format(""), 0.0, 2.0)
assert theirs[2] == 40.0 and abs(ours[0]) < 0.06 and abs(theirs[0]) < 0.06
ours, theirs = compare("and ctrlrange", drive.format('ctrllimited="true" ctrlrange="-1.5 1.5"'), 0.0, 2.0)
assert abs(ours[0]) < 0.06
assert theirs[2] == 1.5 and theirs[0] > 1.2 and np.isclose(theirs[1], -1.5)
ours, theirs = compare("gear 3", '<motor joint="j" gear="3"/>', -2.0, 0.2)
assert np.isclose(ours[1], -6.0) and np.isclose(theirs[1], -2.0)
PY
