# ruff: noqa: T201 - a program prints
"""Poll state, metrics, leases and e-stop with the SDK's periodic tasks. Usage: async_monitor.py HOSTNAME."""

import logging
import sys
import time

import bosdyn.client
import bosdyn.client.util
from bosdyn.client.async_tasks import AsyncGRPCTask, AsyncPeriodicQuery, AsyncTasks
from bosdyn.client.estop import EstopClient
from bosdyn.client.lease import LeaseClient
from bosdyn.client.power import PowerClient
from bosdyn.client.robot_state import RobotStateClient

LOGGER = logging.getLogger("monitor")


class AsyncState(AsyncPeriodicQuery):
    def __init__(self, client):
        super().__init__("robot_state", client, LOGGER, period_sec=0.05)

    def _start_query(self):
        return self._client.get_robot_state_async()


class AsyncMetrics(AsyncPeriodicQuery):
    def __init__(self, client):
        super().__init__("robot_metrics", client, LOGGER, period_sec=0.2)

    def _start_query(self):
        return self._client.get_robot_metrics_async()


class AsyncLeases(AsyncPeriodicQuery):
    def __init__(self, client):
        super().__init__("leases", client, LOGGER, period_sec=0.2)

    def _start_query(self):
        return self._client.list_leases_async()


class AsyncEstop(AsyncPeriodicQuery):
    def __init__(self, client):
        super().__init__("estop", client, LOGGER, period_sec=0.2)

    def _start_query(self):
        return self._client.get_status_async()


class AsyncFans(AsyncGRPCTask):
    def __init__(self, client):
        super().__init__()
        self._client = client
        self.answers = 0

    def _start_query(self):
        return self._client.get_fan_info_async()

    def _should_query(self, now_sec):
        return now_sec - self._last_call > 0.1

    def _handle_result(self, result):
        self.answers += 1

    def _handle_error(self, exception):
        raise exception


def main():
    robot = bosdyn.client.create_standard_sdk("AsyncMonitor").create_robot(sys.argv[1])
    bosdyn.client.util.authenticate(robot)
    state = AsyncState(robot.ensure_client(RobotStateClient.default_service_name))
    metrics = AsyncMetrics(robot.ensure_client(RobotStateClient.default_service_name))
    leases = AsyncLeases(robot.ensure_client(LeaseClient.default_service_name))
    estop = AsyncEstop(robot.ensure_client(EstopClient.default_service_name))
    fans = AsyncFans(robot.ensure_client(PowerClient.default_service_name))
    tasks = AsyncTasks([state, metrics, leases])
    tasks.add_task(estop)
    tasks.add_task(fans)
    deadline = time.time() + 15
    everything = (state, metrics, leases, estop)
    while not (all(task.proto for task in everything) and fans.answers >= 2):
        assert time.time() < deadline, "some task never answered"
        tasks.update()
        time.sleep(0.01)
    print("voltage", round(state.proto.battery_states[0].voltage.value, 1))
    print("metrics", [metric.label for metric in metrics.proto.metrics])
    print("stop level", estop.proto.stop_level)
    print("done")


if __name__ == "__main__":
    main()
