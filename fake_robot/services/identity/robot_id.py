"""RobotIdService: who the robot is."""

from __future__ import annotations

from typing import Any

from bosdyn.api import robot_id_pb2

from fake_robot.scenario.parts import ServicesConfig


class RobotIdService:
    """Tells serial number, species and software version."""

    def __init__(self, config: ServicesConfig) -> None:
        self._config = config

    def GetRobotId(self, request: Any) -> Any:  # noqa: N802
        """The identity from the scenario; the software's name says that this robot is a fake."""
        major, minor, patch = self._config.software_version
        response = robot_id_pb2.RobotIdResponse()
        robot_id = response.robot_id
        robot_id.serial_number = self._config.serial_number
        robot_id.computer_serial_number = self._config.serial_number
        robot_id.species = "spot"
        robot_id.version = "V4"
        robot_id.nickname = self._config.nickname
        release = robot_id.software_release
        release.version.major_version, release.version.minor_version, release.version.patch_level = major, minor, patch
        release.name = "spot-rl fake robot"
        release.type = "fake"
        release.api_version = f"{major}.{minor}.{patch}"
        release.build_information = "simulated"
        return response
