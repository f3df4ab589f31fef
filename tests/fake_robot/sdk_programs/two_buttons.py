# ruff: noqa: T201 - a program prints
"""Two e-stop endpoints of one configuration: either stops, both must allow. Usage: two_buttons.py HOSTNAME."""

import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.api import estop_pb2
from bosdyn.client.estop import (
    ConfigMismatchError,
    EndpointUnknownError,
    EstopClient,
    EstopEndpoint,
    EstopKeepAlive,
    IncorrectChallengeResponseError,
)
from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.power import EstoppedError, is_powered_on, power_off_motors, power_on_motors
from bosdyn.client.robot_command import RobotCommandClient, blocking_stand
from bosdyn.client.robot_state import RobotStateClient


def wait_until(condition, seconds=15):
    deadline = time.time() + seconds
    while not condition():
        assert time.time() < deadline, "waited in vain"
        time.sleep(0.05)


def main():
    robot = bosdyn.client.create_standard_sdk("TwoButtons").create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    robot.time_sync.wait_for_sync()
    client = robot.ensure_client(EstopClient.default_service_name)
    state_client = robot.ensure_client(RobotStateClient.default_service_name)
    power_client = robot.ensure_client("power")

    left = EstopEndpoint(client, "left button", estop_timeout=9.0)
    right = EstopEndpoint(client, "right button", estop_timeout=9.0)
    config = estop_pb2.EstopConfig()
    for endpoint in (left, right):
        config.endpoints.add().CopyFrom(endpoint.to_proto())
    before = client.get_config()
    active = client.set_config(config, before.unique_id)
    for endpoint, entry in zip((left, right), active.endpoints, strict=True):
        endpoint.from_proto(entry)
        endpoint.register(active.unique_id)
    try:
        left.register("another configuration")
    except ConfigMismatchError:
        print("another configuration: refused")
    stranger = EstopEndpoint(client, "stranger", estop_timeout=9.0)
    try:
        client.check_in(estop_pb2.ESTOP_LEVEL_NONE, stranger, 1, 2)
    except EndpointUnknownError:
        print("a stranger: unknown")
    try:
        client.check_in(estop_pb2.ESTOP_LEVEL_NONE, left, 1, 2)
    except IncorrectChallengeResponseError:
        print("a wrong response: refused")

    with EstopKeepAlive(left) as left_button:
        left_button.allow()
        time.sleep(0.3)
        assert robot.is_estopped(), "one of two is enough"
        print("one button alone: stopped")
        with (
            EstopKeepAlive(right) as right_button,
            LeaseKeepAlive(
                robot.ensure_client(LeaseClient.default_service_name), must_acquire=True, return_at_exit=True
            ),
        ):
            right_button.allow()
            wait_until(lambda: not robot.is_estopped())
            power_on_motors(power_client, timeout_sec=20)
            assert is_powered_on(state_client)
            blocking_stand(robot.ensure_client(RobotCommandClient.default_service_name), timeout_sec=10)
            left_button.settle_then_cut()
            wait_until(lambda: not is_powered_on(state_client))
            try:
                power_on_motors(power_client, timeout_sec=20)
            except EstoppedError:
                print("the other one still allows: refused")
            left_button.allow()
            wait_until(lambda: not robot.is_estopped())
            power_on_motors(power_client, timeout_sec=20)
            power_off_motors(power_client, timeout_sec=20)
            levels = {s.endpoint.name: s.stop_level for s in client.get_status().endpoints}
            print("levels", sorted(levels))
    for endpoint in (left, right):
        endpoint.deregister()
    print("endpoints left:", len(client.get_status().endpoints))
    print("done")


if __name__ == "__main__":
    main()
