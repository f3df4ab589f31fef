"""Names of observation terms in other frameworks, and the quantities that they mean."""

from __future__ import annotations

from typing import Final, NamedTuple

from spot_model.errors import BadInputError


class Meaning(NamedTuple):
    """A quantity of our observation, and whether joint positions come without the default pose taken off."""

    field: str
    is_absolute: bool = False


_LINEAR, _ANGULAR = "linear_vel_of_body_in_body_m_s", "angular_vel_of_body_in_body_rad_s"
_GRAVITY, _COMMAND = "projected_gravity_in_body", "velocity_command"
_POSITION, _VELOCITY, _ACTION = "joint_position_offset_rad", "joint_velocity_rad_s", "last_action"

MEANINGS: Final = {
    "base_lin_vel": Meaning(_LINEAR),
    "base_linear_velocity": Meaning(_LINEAR),
    "imu_lin_vel": Meaning(_LINEAR),
    "base_ang_vel": Meaning(_ANGULAR),
    "base_angular_velocity": Meaning(_ANGULAR),
    "imu_ang_vel": Meaning(_ANGULAR),
    "projected_gravity": Meaning(_GRAVITY),
    "velocity_commands": Meaning(_COMMAND),
    "velocity_command": Meaning(_COMMAND),
    "generated_commands": Meaning(_COMMAND),
    "command": Meaning(_COMMAND),
    "commands": Meaning(_COMMAND),
    "twist": Meaning(_COMMAND),
    "joint_pos": Meaning(_POSITION),
    "joint_pos_rel": Meaning(_POSITION),
    "joint_pos_abs": Meaning(_POSITION, is_absolute=True),
    "joint_vel": Meaning(_VELOCITY),
    "joint_vel_rel": Meaning(_VELOCITY),
    "actions": Meaning(_ACTION),
    "last_action": Meaning(_ACTION),
    "action": Meaning(_ACTION),
}
"""By the name of the term, or of the function that fills it in. A term ``joint_pos`` is relative in both frameworks."""


def meaning_of(name: str, source: str) -> Meaning:
    """What a term means.

    Raises:
        BadInputError: It is nothing that the robot reports here, such as a height scan or a gait phase.
    """
    meaning = MEANINGS.get(name)
    if meaning is None:
        raise BadInputError(
            f"{source}: observation term {name!r} is nothing that this runtime observes; it knows "
            f"{', '.join(MEANINGS)}. Train without it"
        )
    return meaning
