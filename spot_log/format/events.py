"""The closed table of event names that a run writes to its log."""

from __future__ import annotations

from enum import Enum
from typing import Final

from spot_log.format.records import Severity

FOLLOWING_MODE: Final = "active"
"""Mode of the ticks in which the policy follows the velocity command."""


class EventName(Enum):
    """Every event, with its severity and what it means."""

    RUN_STARTED = (Severity.INFO, "the run began")
    GAIT = (Severity.INFO, "the gait that the policy's file states")
    GAIT_DOUBTFUL = (Severity.WARNING, "the policy's file states no gait, or that it hops, falls or stays behind")
    CONNECTED = (Severity.INFO, "the robot answered, and the lease is ours")
    CONNECTION_FAILED = (Severity.ERROR, "the robot cannot be used; the text says why")
    REAL_TIME_REFUSED = (Severity.WARNING, "the system refused real-time settings")
    MODE = (Severity.INFO, "the loop changed its mode")
    COMMAND_CLIPPED = (Severity.WARNING, "velocity commands were brought into the policy's range")
    SETPOINT_CUT = (Severity.WARNING, "a limit changed requested set-points")
    STATE_OLD = (Severity.WARNING, "the newest state is older than the warning bound")
    STATE_REJECTED = (Severity.WARNING, "a duplicated or back-dated state was not used")
    STATES_MISSED = (Severity.WARNING, "states did not arrive")
    STATES_REOPENED = (Severity.WARNING, "the robot closed the state stream, and it was opened again")
    COMMANDS_LOST = (Severity.WARNING, "the link loses commands")
    TICKS_SKIPPED = (Severity.WARNING, "policy ticks were lost")
    CLOCK_UNSYNCED = (Severity.WARNING, "the robot does not answer time syncs; its clock is extrapolated")
    LOG_PROBLEM = (Severity.WARNING, "the log lost something")
    FAULT = (Severity.WARNING, "the robot reports a fault that does not end the run")
    STOP = (Severity.ERROR, "the run ends before its time; the text says why")
    STOP_WANTED = (Severity.INFO, "an operator ends the run in good order; its name in the log is stop, too")
    COMPLETED = (Severity.INFO, "the command sequence is done")
    INCIDENT = (Severity.INFO, "what led to the stop was written to a file of its own")
    INCIDENT_FAILED = (Severity.WARNING, "the incident file could not be written")
    GUARDIAN_LOST = (Severity.WARNING, "the process that makes the robot safe after a crash has ended")
    NO_KEEPALIVE = (Severity.INFO, "the robot does not watch for this program's silence; the guardian alone does")
    LEFTOVER = (Severity.INFO, "a log that a crash had left behind was recovered")
    ARMED = (Severity.INFO, "the robot stands under the vendor's control and waits for the operator")
    LABEL = (Severity.INFO, "the operator labelled the log: key=value")
    POLICY_SWITCHED = (Severity.INFO, "another policy was loaded while standing")
    STAND_FAILED = (Severity.WARNING, "the vendor's stand was not reached at the end; the robot sits down all the same")
    SIGNAL_DOUBTED = (Severity.WARNING, "a signal is wrong on which nothing relies, or about which the run only warns")
    IMPORT_DOUBTED = (Severity.WARNING, "a signal of an imported recording is probably not what its mapping says")
    LEASE_TAKEN_UP = (Severity.WARNING, "a lost lease that nobody had any more was taken, to power the robot off")
    POWER_OFF = (Severity.INFO, "the robot sits and its motors are off")
    POWER_OFF_FAILED = (Severity.ERROR, "the robot could not be powered off")

    @property
    def label(self) -> str:
        """The name in the log."""
        return "stop" if self is EventName.STOP_WANTED else self.name.lower()

    @property
    def severity(self) -> Severity:
        """How much it matters."""
        return self.value[0]
