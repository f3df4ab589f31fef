# ruff: noqa: T201 - a program prints
"""Take over the e-stop, hold it, press it while standing, release it. Usage: estop_program.py HOSTNAME."""

import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.client.estop import EstopClient, EstopEndpoint, EstopKeepAlive
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.power import EstoppedError
from bosdyn.client.robot_command import RobotCommandClient, blocking_stand


def wait_until(condition, seconds=15):
    deadline = time.time() + seconds
    while not condition():
        assert time.time() < deadline, "waited in vain"
        time.sleep(0.05)


def main():
    sdk = bosdyn.client.create_standard_sdk("EstopProgram")
    robot = sdk.create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    client = robot.ensure_client(EstopClient.default_service_name)
    endpoint = EstopEndpoint(client, "estop program", estop_timeout=9.0)
    endpoint.force_simple_setup()
    lease_client = robot.ensure_client(LeaseClient.default_service_name)
    command_client = robot.ensure_client(RobotCommandClient.default_service_name)
    robot.time_sync.wait_for_sync()
    with EstopKeepAlive(endpoint) as keep_alive, LeaseKeepAlive(lease_client, must_acquire=True, return_at_exit=True):
        keep_alive.stop()
        try:
            robot.power_on(timeout_sec=20)
        except EstoppedError:
            print("refused while stopped")
        else:
            raise AssertionError("the robot powered on while stopped")
        keep_alive.allow()
        wait_until(lambda: not robot.is_estopped())
        robot.power_on(timeout_sec=20)
        blocking_stand(command_client, timeout_sec=10)
        keep_alive.settle_then_cut()
        wait_until(lambda: not robot.is_powered_on())
        print("settled, then cut")
        keep_alive.allow()
        wait_until(lambda: not robot.is_estopped())
        robot.power_on(timeout_sec=20)
        blocking_stand(command_client, timeout_sec=10)
        keep_alive.stop()
        wait_until(lambda: not robot.is_powered_on(), seconds=5)
        print("cut")
        print(client.get_status().stop_level_details)
    endpoint.deregister()
    print("done")


if __name__ == "__main__":
    main()
