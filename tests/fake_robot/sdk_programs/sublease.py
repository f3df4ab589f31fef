# ruff: noqa: T201 - a program prints
"""An owner lends its lease to a helper and takes it back by using its own. Usage: sublease.py HOSTNAME."""

import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.client.exceptions import LeaseUseError
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive, LeaseNotOwnedByWallet, NoSuchLease
from bosdyn.client.robot_command import RobotCommandBuilder, RobotCommandClient, blocking_sit, blocking_stand


def connect(name, hostname):
    robot = bosdyn.client.create_standard_sdk(name).create_robot(hostname)
    bosdyn.client.util.authenticate(robot)
    robot.time_sync.wait_for_sync()
    return robot


def main():
    owner, helper = connect("Owner", sys.argv[1]), connect("Helper", sys.argv[1])
    leases = owner.ensure_client(LeaseClient.default_service_name)
    own_commands = owner.ensure_client(RobotCommandClient.default_service_name)
    commands = helper.ensure_client(RobotCommandClient.default_service_name)
    try:
        helper.lease_wallet.get_lease()
    except NoSuchLease:
        print("a wallet without a lease says so")
    with LeaseKeepAlive(leases, must_acquire=True, return_at_exit=True) as keep_alive:
        assert keep_alive.is_alive()
        owner.power_on(timeout_sec=20)
        lent = owner.lease_wallet.get_lease().create_sublease(helper.lease_wallet.client_name)
        helper.lease_wallet.add(lent)
        blocking_stand(commands, timeout_sec=10)
        print("the helper stands the robot")
        listed = leases.list_leases_full()
        names = {resource.resource for resource in listed.resources}
        assert "body" in names, names
        assert list(listed.resource_tree.sub_resources), listed.resource_tree

        # A newer lease of the owner outdates what was lent.
        owner.lease_wallet.advance()
        own_commands.robot_command(RobotCommandBuilder.synchro_stand_command(body_height=0.03))
        try:
            commands.robot_command(RobotCommandBuilder.synchro_sit_command())
        except LeaseUseError as error:
            print("then refused with", error.lease_use_result.Status.Name(error.lease_use_result.status))
        else:
            raise AssertionError("what was lent still works")
        try:
            helper.lease_wallet.get_lease()
        except LeaseNotOwnedByWallet as error:
            print("and its wallet knows:", error.lease_state.lease_status.name)

        # Lent again, from the newer one; two clients command in turn, each with a lease of its own.
        for height in (0.0, 0.02):
            again = owner.lease_wallet.advance().create_sublease(helper.lease_wallet.client_name)
            stand = RobotCommandBuilder.synchro_stand_command(body_height=height)
            commands.robot_command(stand, lease=again.lease_proto)
            time.sleep(0.2)
        blocking_sit(own_commands, timeout_sec=10)
        owner.power_off(cut_immediately=False, timeout_sec=20)
    owner_after = {r.resource: r.lease_owner.client_name for r in leases.list_leases()}
    print("left to", repr(owner_after.get("body", "")))
    print("done")


if __name__ == "__main__":
    main()
