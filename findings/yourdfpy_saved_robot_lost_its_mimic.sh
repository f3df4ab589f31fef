#!/usr/bin/env bash
# yourdfpy 0.0.60: a URDF that is loaded and saved again has lost its mimic joints, soft limits and transmissions.
#
# write_xml_file writes links, joints, limits and dynamics. A joint that follows another one moves freely in the file
# that comes out, one more number of the configuration; safety_controller and calibration, which the reader knows, are
# gone, and so are transmission and gazebo elements. Nothing is said. Before that, center_cfg, the middle of all limits,
# writes the follower's value in the place of whatever actuated joint has its index, or raises IndexError. Whoever edits
# a URDF with it: copy these elements over by hand, and compare actuated_joint_names before and after.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "yourdfpy==0.0.60" "numpy==2.4.6"
"$folder/venv/bin/python" - "$folder" <<'PY'
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
import yourdfpy

assert version("yourdfpy") == "0.0.60"
first, second = Path(sys.argv[1]) / "first.urdf", Path(sys.argv[1]) / "second.urdf"
LIMIT = '<limit lower="{}" upper="{}" effort="5" velocity="2"/>'
first.write_text(f"""<robot name="gripper"><link name="palm"/><link name="left"/><link name="right"/><link name="tip"/>
  <joint name="close" type="revolute"><parent link="palm"/><child link="left"/><axis xyz="0 0 1"/>{LIMIT.format(0.5, 1)}
    <dynamics damping="0.5" friction="0.3"/><calibration rising="0.1"/>
    <safety_controller k_velocity="10" k_position="15" soft_lower_limit="0.6" soft_upper_limit="0.9"/></joint>
  <joint name="follow" type="revolute"><parent link="palm"/><child link="right"/><axis xyz="0 0 -1"/>
    {LIMIT.format(-3, 3)}<mimic joint="close" multiplier="2" offset="0.1"/></joint>
  <joint name="slide" type="prismatic"><parent link="left"/><child link="tip"/><axis xyz="1 0 0"/>
    {LIMIT.format(-1, 1)}</joint>
  <transmission name="drive"><type>SimpleTransmission</type><joint name="close"/></transmission>
  <gazebo reference="tip"><mu1>0.2</mu1></gazebo></robot>""")
robot = yourdfpy.URDF.load(first, load_meshes=False)
print("actuated:", robot.actuated_joint_names, "- middle of their limits:", robot.center_cfg)
assert robot.actuated_joint_names == ["close", "slide"]
assert np.allclose(robot.center_cfg, [0.75, 2 * 0.75 + 0.1])  # the slide's middle is 0

robot.write_xml_file(second)
before, after = first.read_text(), second.read_text()
parts = ("mimic", "safety_controller", "calibration", "transmission", "gazebo", "dynamics", "limit")
lost = [part for part in parts if f"<{part}" in before and f"<{part}" not in after]
again = yourdfpy.URDF.load(second, load_meshes=False)
print("lost:", lost, "- actuated after it:", again.actuated_joint_names)
assert lost == ["mimic", "safety_controller", "calibration", "transmission", "gazebo"]
assert again.actuated_joint_names == ["close", "follow", "slide"]
PY
