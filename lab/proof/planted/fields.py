"""Errors of one field of an answer each."""

from __future__ import annotations

from bosdyn.api import estop_pb2, header_pb2, lease_pb2, power_pb2, robot_command_pb2, robot_state_pb2

from proof.planted.planting import (
    CLEAR_FAULT,
    COMMAND,
    ESTOP_STATUS,
    JOINTS,
    LEASES,
    NAMED,
    POWER,
    POWER_FEEDBACK,
    RETAIN,
    RETURN,
    ROBOT_ID,
    SERVICE,
    SERVICES,
    SIBLING,
    STATE,
    STREAM,
    TIME_SYNC,
    changed,
)

# fmt: off
changed("motor_state_always_on", "The motors are reported on whatever they are.",
         STATE, "robot_state.power_state.motor_power_state",
         robot_state_pb2.PowerState.MOTOR_POWER_STATE_ON, source="outside")
changed("motor_state_always_off", "The motors are reported off whatever they are.",
         STATE, "robot_state.power_state.motor_power_state",
         robot_state_pb2.PowerState.MOTOR_POWER_STATE_OFF, source="outside", needs_motion=True)
changed("load_negated_in_poll", "Joint loads of GetRobotState have the other sign.",
         STATE, "robot_state.kinematic_state.joint_states.*.load.value",
         lambda x: -x, source="outside", needs_motion=True)
changed("contacts_inverted_in_poll", "A foot on the ground is polled as lost, one in the air as made.",
         STATE, "robot_state.foot_state.*.contact", lambda x: 3 - x, source="outside", needs_motion=True)
changed("robot_without_serial", "The robot has no serial number.", ROBOT_ID, "robot_id.serial_number", "")
changed("directory_finds_anything", "A service that does not exist is answered with OK and an empty entry.",
         SERVICE, "status", 1)
changed("header_without_code", "Unary answers leave the error code unspecified.",
         f"{STATE} {ESTOP_STATUS} {LEASES} {TIME_SYNC} {ROBOT_ID} {SERVICES}", "header.error.code",
         header_pb2.CommonError.CODE_UNSPECIFIED)
changed("time_sync_never_ends", "Time synchronisation always needs more samples.", TIME_SYNC, "state.status", 2)
changed("positions_in_degrees", "Polled joint positions are in degrees.",
         STATE, "robot_state.kinematic_state.joint_states.*.position.value", lambda x: x * 57.29578)
changed("feet_mirrored_upwards", "The feet are above the body.",
         STATE, "robot_state.foot_state.*.foot_position_rt_body.z", lambda x: -x)
changed("battery_as_a_fraction", "The battery's charge is a fraction, not a percentage.",
         STATE, "robot_state.battery_states.*.charge_percentage.value", lambda x: x / 100.0)
changed("battery_in_millivolts", "The battery's voltage is in millivolts.",
         STATE, "robot_state.battery_states.*.voltage.value", lambda x: x * 1000.0)
changed("estop_not_in_the_state", "The state has no e-stops.", STATE, "robot_state.estop_states", None)
changed("estop_in_the_state_never_stopped", "The state's e-stops are released whatever they are.",
         STATE, "robot_state.estop_states.*.state", robot_state_pb2.EStopState.STATE_NOT_ESTOPPED)
changed("always_standing", "The robot says that it stands, with its motors off.",
         STATE, "robot_state.behavior_state.state", robot_state_pb2.BehaviorState.STATE_STANDING)
changed("acceleration_without_gravity", "The inertial unit measures no gravity.",
         STREAM, "inertial_state.packets.*.acceleration_rt_odom_in_link_frame.z", lambda x: x - 9.81)
changed("command_key_not_echoed", "The last command's key is not in the stream.",
         STREAM, "last_command", None, needs_motion=True)
changed("lost_lease_retained", "A lease that was taken away can still be retained.",
         RETAIN, "lease_use_result.status", lease_pb2.LeaseUseResult.STATUS_OK)
changed("owners_not_listed", "The list of leases names no owner.", LEASES, "resources.*.lease_owner", None)
changed("any_lease_can_be_returned", "A lease that its bearer does not hold is accepted as returned.",
         RETURN, "status", lease_pb2.ReturnLeaseResponse.STATUS_OK)
changed("lease_result_missing", "Answers do not say what the lease was worth.",
         f"{COMMAND} {POWER} {RETAIN}", "lease_use_result", None)
changed("estop_endpoints_not_listed", "The e-stop's status lists no endpoint.",
         ESTOP_STATUS, "status.endpoints", None)
changed("estop_always_released", "The e-stop's status is released, whatever its endpoints ask for.",
         ESTOP_STATUS, "status.stop_level", estop_pb2.ESTOP_LEVEL_NONE)
changed("power_feedback_of_nothing_succeeds", "A power command that was never given has succeeded.",
         POWER_FEEDBACK, "status", power_pb2.STATUS_SUCCESS)
changed("clears_faults_that_are_not", "A behaviour fault that does not exist is cleared.",
         CLEAR_FAULT, "status", robot_command_pb2.ClearBehaviorFaultResponse.STATUS_CLEARED)
changed("joint_stream_always_ok",
         "A stream of joint commands ends with OK whatever was sent, and whatever the robot's mode.",
         JOINTS, "status", robot_command_pb2.JointControlStreamResponse.STATUS_OK)
changed("joint_stream_without_words", "A stream of joint commands that is refused gets no reason.",
         JOINTS, "message", "")
changed("service_faults_not_shown", "A fault that a service raised is not in the state.",
         STATE, "robot_state.service_fault_state.faults", None)
changed("service_faults_without_a_time", "A service's fault does not say since when.",
         STATE, "robot_state.service_fault_state.faults.*.onset_timestamp", None)
changed("battery_current_negated", "The battery's current is positive while it discharges.",
         STATE, "robot_state.battery_states.*.current.value", lambda x: -x, source=NAMED)
changed("battery_in_kelvin", "The motors' temperatures are in kelvins.",
         STATE, "robot_state.system_state.motor_temperatures.*.temperature", lambda x: x + 273.15, source=SIBLING)
changed("power_never_comes", "The feedback never says that the motors have got power.",
         POWER_FEEDBACK, "status", power_pb2.STATUS_IN_PROGRESS, source=SIBLING, needs_motion=True)
changed("estop_always_pressed", "The e-stop's status is a cut, whatever its endpoints ask for.",
         ESTOP_STATUS, "status.stop_level", estop_pb2.ESTOP_LEVEL_CUT, source=SIBLING)
# fmt: on
