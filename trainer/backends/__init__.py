"""The simulators under the task: MuJoCo on CPUs, mujoco_warp on an NVIDIA GPU."""
