"""FaultService: service faults that clients raise and clear; GetRobotState shows them."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from bosdyn.api import robot_state_pb2, service_fault_pb2

from fake_robot.services.calls.stamps import duration_from_ns, ns_from_timestamp, timestamp_from_ns

MAX_FAULTS = 256
MAX_HISTORY = 32
LIVENESS_FAULT = "Service Liveness Fault"
"""The fake's name for it; the vendor publishes none."""

FaultKey = tuple[str, str, str]


@dataclass
class ServiceFaults:
    """Active and past service faults. Thread-safe."""

    robot_now_ns: Callable[[], int]
    _active: dict[FaultKey, service_fault_pb2.ServiceFault] = field(default_factory=dict)
    _history: deque[service_fault_pb2.ServiceFault] = field(default_factory=lambda: deque(maxlen=MAX_HISTORY))
    _lock: threading.Lock = field(default_factory=threading.Lock)

    def trigger(self, fault: service_fault_pb2.ServiceFault) -> bool:
        """Raise a fault; False if it is active already."""
        with self._lock:
            key = _key(fault.fault_id)
            if key in self._active or len(self._active) >= MAX_FAULTS:
                return False
            kept = service_fault_pb2.ServiceFault()
            kept.CopyFrom(fault)
            kept.onset_timestamp.CopyFrom(timestamp_from_ns(self.robot_now_ns()))
            self._active[key] = kept
            return True

    def clear(self, matches: Callable[[service_fault_pb2.ServiceFaultId], bool]) -> int:
        """Clear the faults that match; returns how many did."""
        with self._lock:
            cleared = [key for key, fault in self._active.items() if matches(fault.fault_id)]
            for key in cleared:
                fault = self._active.pop(key)
                age_ns = self.robot_now_ns() - ns_from_timestamp(fault.onset_timestamp)
                fault.duration.CopyFrom(duration_from_ns(age_ns))
                self._history.append(fault)
            return len(cleared)

    def state(self) -> robot_state_pb2.ServiceFaultState:
        """Active and past faults, and the worst severity of each attribute."""
        with self._lock:
            state = robot_state_pb2.ServiceFaultState(
                faults=self._active.values(), historical_faults=list(self._history)
            )
            for fault in self._active.values():
                for attribute in fault.attributes:
                    state.aggregated[attribute] = max(state.aggregated[attribute], fault.severity)
            return state


class FaultService:
    """Raises and clears service faults."""

    def __init__(self, records: ServiceFaults) -> None:
        self._records = records

    def TriggerServiceFault(self, request: Any) -> Any:  # noqa: N802
        """Raise a fault."""
        response = service_fault_pb2.TriggerServiceFaultResponse()
        is_new = self._records.trigger(request.fault)
        response.status = response.STATUS_OK if is_new else response.STATUS_FAULT_ALREADY_ACTIVE
        return response

    def ClearServiceFault(self, request: Any) -> Any:  # noqa: N802
        """Clear one fault, or all of a service or of a payload."""
        response = service_fault_pb2.ClearServiceFaultResponse()
        wanted = request.fault_id

        def matches(fault: service_fault_pb2.ServiceFaultId) -> bool:
            if request.clear_all_service_faults and fault.service_name == wanted.service_name:
                return True
            if request.clear_all_payload_faults and fault.payload_guid == wanted.payload_guid:
                return True
            return _key(fault) == _key(wanted)

        is_known = self._records.clear(matches) > 0
        response.status = response.STATUS_OK if is_known else response.STATUS_FAULT_NOT_ACTIVE
        return response


def liveness_fault(service_name: str) -> service_fault_pb2.ServiceFault:
    """The fault of a service that no longer refreshes its entry in the directory."""
    fault = service_fault_pb2.ServiceFault(severity=service_fault_pb2.ServiceFault.SEVERITY_CRITICAL)
    fault.fault_id.fault_name, fault.fault_id.service_name = LIVENESS_FAULT, service_name
    fault.error_message = f"service {service_name} has not refreshed its directory entry within its liveness time-out"
    return fault


def _key(fault_id: service_fault_pb2.ServiceFaultId) -> FaultKey:
    return fault_id.fault_name, fault_id.service_name, fault_id.payload_guid
