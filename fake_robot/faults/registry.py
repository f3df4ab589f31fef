"""Faults of the body, by name: what can be made to go wrong while the robot runs.

A fault acts for a while, or until it is cleared. Most change :class:`~fake_robot.faults.fault_effects.Knobs`, summed up
anew whenever a fault comes or goes; a few do something once, at their start. What only the network or the services can
do (tokens, leases, e-stop buttons, closed streams, reboots) is theirs.
"""

from __future__ import annotations

from typing import Any, Final

from pydantic import ValidationError

from fake_robot.faults import body as faults_of_body
from fake_robot.faults import link as faults_of_link
from fake_robot.faults import sensors as faults_of_sensors
from fake_robot.faults.fault import Fault
from spot_model.errors import BadInputError
from spot_model.io.validation import explain

FAULTS: Final[dict[str, type[Fault]]] = {
    fault.name: fault
    for fault in (
        faults_of_link.StateGap,
        faults_of_link.StateDelay,
        faults_of_link.StateJitter,
        faults_of_link.StateDrops,
        faults_of_link.DuplicatedStates,
        faults_of_link.BackDatedStates,
        faults_of_link.MalformedStates,
        faults_of_link.CommandDelay,
        faults_of_link.CommandJitter,
        faults_of_link.CommandDrops,
        faults_of_sensors.FrozenSensors,
        faults_of_sensors.NanSensor,
        faults_of_sensors.BadQuaternion,
        faults_of_link.ClockJump,
        faults_of_body.LowBattery,
        faults_of_body.BatteryFault,
        faults_of_body.MotorOverTemperature,
        faults_of_body.WeakMotor,
        faults_of_body.SystemFaultRaised,
        faults_of_body.BehaviorFaultRaised,
        faults_of_body.PowerLoss,
        faults_of_body.Push,
    )
}


def make_fault(name: str, parameters: dict[str, Any]) -> Fault:
    """Build a fault from its name and parameters.

    Raises:
        BadInputError: The name or a parameter is unknown, or a value is not allowed; the message says which are.
    """
    if name not in FAULTS:
        raise BadInputError(f"fault {name!r} is unknown; allowed: {', '.join(FAULTS)}")
    try:
        return FAULTS[name].model_validate(parameters, strict=True)
    except ValidationError as error:
        raise BadInputError(f"fault {name}:\n{explain(error, FAULTS[name])}") from error
