"""Names of observation terms in other frameworks, and the quantities that they mean."""

from __future__ import annotations

from typing import Final, NamedTuple

from spot_model.errors import BadInputError
from spot_model.policy.observation import OBSERVATION


class Meaning(NamedTuple):
    """A quantity of our observation, and whether joint positions come without the default pose taken off."""

    field: str
    is_absolute: bool = False


# In the order of our observation: a field more or less fails here.
_LINEAR, _ANGULAR, _GRAVITY, _COMMAND, _POSITION, _VELOCITY, LAST_ACTION = (field.name for field in OBSERVATION)

MEANINGS: Final = {
    "base_lin_vel": Meaning(_LINEAR),
    "base_linear_velocity": Meaning(_LINEAR),
    "imu_lin_vel": Meaning(_LINEAR),
    "base_ang_vel": Meaning(_ANGULAR),
    "base_angular_velocity": Meaning(_ANGULAR),
    "imu_ang_vel": Meaning(_ANGULAR),
    "projected_gravity": Meaning(_GRAVITY),
    "command": Meaning(_COMMAND),
    "velocity_commands": Meaning(_COMMAND),
    "velocity_command": Meaning(_COMMAND),
    "generated_commands": Meaning(_COMMAND),
    "commands": Meaning(_COMMAND),
    "twist": Meaning(_COMMAND),
    "joint_pos": Meaning(_POSITION),
    "joint_pos_rel": Meaning(_POSITION),
    "joint_pos_abs": Meaning(_POSITION, is_absolute=True),
    "joint_vel": Meaning(_VELOCITY),
    "joint_vel_rel": Meaning(_VELOCITY),
    "actions": Meaning(LAST_ACTION),
    "last_action": Meaning(LAST_ACTION),
    "action": Meaning(LAST_ACTION),
}
"""By the name of the term, or of the function that fills it in. A term ``joint_pos`` is relative in both frameworks."""


MJLAB_NAMES: Final = {meaning.field: name for name, meaning in reversed(MEANINGS.items())}
"""mjlab's name of each of our fields: the first above that means it."""
JOINT_FIELDS: Final = frozenset(field.name for field in OBSERVATION if field.is_of_joints)


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
