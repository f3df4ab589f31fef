#!/usr/bin/env bash
# newton 1.8.0: of one URDF's friction, damping and effort limit, SolverMuJoCo obeys all, others one or none.
#
# The builder reads all three, and the model holds them. Featherstone and the semi-implicit solver then leave out the
# friction and the limit, XPBD the damping as well. A position drive that may give 5 N m makes an arm over 100 times as
# fast as it can, and a joint runs on that should have slowed down. None of the four keeps to the velocity limit, and
# none says a word. Whoever moves a policy from one solver to another: compare one joint's motion before.
# (The first run compiles for some minutes.)
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "newton==1.8.0" "warp-lang==1.19.0" \
    "mujoco==3.17.0" "mujoco-warp==3.17.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
from importlib.metadata import version

import newton
import numpy as np
import warp as wp

assert version("newton") == "1.8.0"
wp.config.quiet = True
ARM = """<robot name="arm"><link name="post"/>
<link name="arm"><inertial><mass value="1"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="continuous"><parent link="post"/><child link="arm"/><axis xyz="0 0 1"/>
<limit effort="5" velocity="0.7"/><dynamics damping="{damping}" friction="{friction}"/></joint></robot>"""
SOLVERS = ("SolverMuJoCo", "SolverFeatherstone", "SolverSemiImplicit", "SolverXPBD")


def speed(solver: str, *, steps: int, damping=0.0, friction=0.0, start=0.0, stiffness=0.0) -> float:
    """The arm's speed in rad/s after steps of 1 ms, with a drive towards 1 rad where it is stiff; no gravity."""
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))
    kind = getattr(newton.solvers, solver)
    if hasattr(kind, "register_custom_attributes"):
        kind.register_custom_attributes(builder)
    builder.add_urdf(ARM.format(damping=damping, friction=friction), floating=False)
    builder.joint_target_ke[0] = stiffness
    builder.joint_target_mode[0] = int(newton.JointTargetMode.POSITION)
    model = builder.finalize(device="cpu")
    assert np.allclose(model.joint_damping.numpy(), damping) and np.allclose(model.joint_friction.numpy(), friction)
    assert np.allclose(model.joint_effort_limit.numpy(), 5.0) and np.allclose(model.joint_velocity_limit.numpy(), 0.7)
    state, following, control = model.state(), model.state(), model.control()
    control.joint_target_q.assign(np.array([1.0], np.float32))
    state.joint_qd.assign(np.array([start], np.float32))
    newton.eval_fk(model, state.joint_q, state.joint_qd, state)
    simulation = kind(model)
    for _ in range(steps):
        state.clear_forces()
        simulation.step(state, following, control, None, 0.001)
        state, following = following, state
    if solver in ("SolverSemiImplicit", "SolverXPBD"):
        newton.eval_ik(model, state, state.joint_q, state.joint_qd)
    return float(state.joint_qd.numpy()[0])


print("speed of an arm of 0.1 kg m2 that began at 1 rad/s, after 0.5 s; and of one at rest, driven for 0.01 s")
for solver in SOLVERS:
    free = speed(solver, steps=500, start=1.0)
    damped = speed(solver, steps=500, start=1.0, damping=0.1)
    rubbing = speed(solver, steps=500, start=1.0, friction=0.05)
    driven = speed(solver, steps=10, stiffness=1000.0)
    print(f"{solver:18} free {free:.2f}, damping {damped:.2f} (0.61), friction {rubbing:.2f} (0.75), ", end="")
    print(f"driven by 5 N m at most {driven:.2f} (0.50)", flush=True)
    assert free > 0.97
    assert np.isclose(damped, 0.61, atol=0.02) == (solver != "SolverXPBD") and (damped < 0.62 or damped > 0.99)
    assert np.isclose(rubbing, 0.75, atol=0.01) == (solver == "SolverMuJoCo")
    assert np.isclose(driven, 0.5, atol=0.01) == (solver == "SolverMuJoCo")
    assert solver == "SolverMuJoCo" or (np.isclose(rubbing, free) and driven > 50.0)
PY
