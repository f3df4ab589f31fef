# ruff: noqa: T201 - a program prints
"""Two clients of one robot: one holds the lease, the other takes it. Usage: lease_takeover.py HOSTNAME."""

import sys

import bosdyn.client
import bosdyn.client.util
from bosdyn.client.exceptions import LeaseUseError
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive, LeaseState, ResourceAlreadyClaimedError
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandClient, blocking_sit, blocking_stand


def connect(name, hostname):
    robot = bosdyn.client.create_standard_sdk(name).create_robot(hostname)
    bosdyn.client.util.authenticate(robot)
    robot.time_sync.wait_for_sync()
    return robot, robot.ensure_client(LeaseClient.default_service_name)


def main():
    first, first_leases = connect("First", sys.argv[1])
    second, second_leases = connect("Second", sys.argv[1])
    with LeaseKeepAlive(first_leases, must_acquire=True):
        first.power_on(timeout_sec=20)
        blocking_stand(first.ensure_client(RobotCommandClient.default_service_name), timeout_sec=10)
        try:
            second_leases.acquire()
        except ResourceAlreadyClaimedError as error:
            print("owner", error.response.lease_owner.client_name.split(":")[0])
        else:
            raise AssertionError("the lease was given out twice")
    second_leases.take()
    try:
        first.ensure_client(RobotCommandClient.default_service_name).robot_command(
            RobotCommandBuilder.synchro_sit_command()
        )
    except LeaseUseError as error:
        print("refused with", error.lease_use_result.Status.Name(error.lease_use_result.status))
    else:
        raise AssertionError("the old lease still works")
    assert first.lease_wallet.get_lease_state().lease_status == LeaseState.Status.OTHER_OWNER
    with LeaseKeepAlive(second_leases, return_at_exit=True):
        commands = second.ensure_client(RobotCommandClient.default_service_name)
        blocking_stand(commands, timeout_sec=10)
        blocking_sit(commands, timeout_sec=10)
        second.power_off(cut_immediately=False, timeout_sec=20)
    print([resource.resource for resource in second_leases.list_leases()])
    print("done")


if __name__ == "__main__":
    main()
