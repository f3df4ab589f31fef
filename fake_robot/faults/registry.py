"""Every fault by name. A class with a name, in one of the modules imported here or anywhere else, is in it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from pydantic import ValidationError

from fake_robot.faults import body, link, sensors, services
from fake_robot.faults.fault import FAULTS, Fault, ServiceFault
from fake_robot.network.status import FaultKind
from spot_model.errors import BadInputError
from spot_model.io.settings import explain

__all__ = ["FAULTS", "body", "fault_kinds", "link", "make_fault", "sensors", "services"]


def make_fault(name: str, parameters: Mapping[str, Any]) -> Fault:
    """Build a fault from its name and parameters.

    Raises:
        BadInputError: The name or a parameter is unknown, or a value is not allowed; the message says which are.
    """
    if name not in FAULTS:
        raise BadInputError(f"there is no fault {name!r}; allowed: {', '.join(sorted(FAULTS))}")
    try:
        return FAULTS[name].model_validate(dict(parameters), strict=True)
    except ValidationError as error:
        raise BadInputError(f"fault {name}:\n{explain(error, FAULTS[name])}") from error


def fault_kinds(*, of_services: bool) -> tuple[FaultKind, ...]:
    """The faults of the services, or those of the body, with the meaning of their parameters."""
    return tuple(
        FaultKind(
            name,
            (fault.__doc__ or "").strip(),
            {key: info.description or "" for key, info in fault.model_fields.items()},
        )
        for name, fault in FAULTS.items()
        if issubclass(fault, ServiceFault) is of_services
    )
