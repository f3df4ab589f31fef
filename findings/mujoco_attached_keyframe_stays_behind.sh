#!/usr/bin/env bash
# mujoco 4.0.0: a robot that is attached with its keyframe goes back to the origin in that keyframe.
#
# MjSpec.attach puts a robot with a free joint at a frame, and the model's own start follows. The keyframe comes along,
# with its prefix and as long as the new model needs, but its free joint keeps the old pose: a reset to it takes the
# robot away from the frame. And it is a keyframe of that robot alone: the others are in their defaults, at their
# frames, so two robots that each have a "home" have none in which both are at home.
# Whoever builds scenes: write the keyframe anew after attaching, with free joints from qpos0 and the rest from the old.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "mujoco==4.0.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import mujoco

ROBOT = """
<mujoco>
  <worldbody>
    <body name="trunk" pos="0 0 0.5">
      <freejoint/><geom size="0.1"/>
      <body pos="0 0 -0.2"><joint name="knee" axis="0 1 0"/><geom size="0.05"/></body>
    </body>
  </worldbody>
  <keyframe><key name="home" qpos="0 0 0.4 1 0 0 0 0.7"/></keyframe>
</mujoco>"""
assert mujoco.__version__ == "4.0.0"
scene = mujoco.MjSpec()
for name, x_m in (("a_", 2.0), ("b_", 4.0)):
    scene.attach(mujoco.MjSpec.from_string(ROBOT), frame=scene.worldbody.add_frame(pos=[x_m, 0, 1]), prefix=name)
model = scene.compile()
data = mujoco.MjData(model)


def places():
    """Where the trunks are, and the knees' angles."""
    mujoco.mj_forward(model, data)
    return [data.body(f"{n}_trunk").xpos.tolist() for n in "ab"], [float(data.joint(f"{n}_knee").qpos[0]) for n in "ab"]


start = places()
print("start: ", *start)
assert start == ([[2.0, 0.0, 1.5], [4.0, 0.0, 1.5]], [0.0, 0.0])
seen = {}
for key in range(model.nkey):
    mujoco.mj_resetDataKeyframe(model, data, key)
    seen[model.key(key).name] = places()
    print(f"{model.key(key).name}:", *seen[model.key(key).name])
assert seen == {
    "a_home": ([[0.0, 0.0, 0.4], [4.0, 0.0, 1.5]], [0.7, 0.0]),
    "b_home": ([[2.0, 0.0, 1.5], [0.0, 0.0, 0.4]], [0.0, 0.7]),
}
PY
