"""The polled state, the 333 Hz stream, and the skeleton: links under the vendor's names, each with a box around it.

The skeleton's URDF is of our own numbers.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import grpc
from bosdyn.api import robot_state_pb2, robot_state_service_pb2

from fake_robot.services.calls import Service, refuse, timestamp_from_ns
from fake_robot.services.reports.state_message import fill_state
from fake_robot.services.world import World
from spot_model.robot import arm, facts
from spot_model.robot.arm import ARM_LINK_NAMES
from spot_model.robot.mjcf import BODY_HALF_SIZE_M

_Corners = tuple[tuple[float, float], tuple[float, float], tuple[float, float]]
_Vector = tuple[float, float, float]

_FACES = ((1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4))
"""Corners of each side, seen from outside against the clock; corner 1 has the least x, y, z, and z changes first."""


def _between(end_m: _Vector, half_m: float) -> _Corners:
    """The box around a link that leads from its joint to ``end_m``."""
    x, y, z = end_m
    return (min(0.0, x) - half_m, max(0.0, x) + half_m), (y - half_m, y + half_m), (z - half_m, half_m)


def _around(half_m: _Vector) -> _Corners:
    x, y, z = half_m
    return (-x, x), (-y, y), (-z, z)


BASE = "base"
_OF_LEG: dict[str, _Corners] = {
    "hip": _around((0.11, 0.05, 0.05)),
    "uleg": _between(facts.KN_FROM_HY_M, 0.05),
    "lleg": _between(facts.FOOT_FROM_KN_M, facts.FOOT_RADIUS_M),
}
"""The link behind each joint of a leg."""
_BOXES: dict[str, _Corners] = {
    BASE: _around(BODY_HALF_SIZE_M),
    **{f"{leg}.{part}": box for leg in facts.LEG_NAMES for part, box in _OF_LEG.items()},
}
LINK_NAMES = tuple(_BOXES)
"""The links, as the vendor's published URDF names them."""
ARM_LINKS = {f"arm0.{name}": link for name, link in zip(ARM_LINK_NAMES, arm.ARM_LINKS, strict=True)}
"""Those of an arm."""
_BOXES |= {name: _around((0.08, 0.06, 0.06)) for name in ARM_LINKS}


def link_names(*, has_arm: bool) -> tuple[str, ...]:
    """The links of a robot."""
    return (*LINK_NAMES, *ARM_LINKS) if has_arm else LINK_NAMES


def outline_obj(link: str) -> str:
    """The OBJ text of a link's box, in metres, in the link's frame. Raises KeyError for an unknown link."""
    corners = [f"v {x:g} {y:g} {z:g}" for x, y, z in product(*_BOXES[link])]
    faces = [f"f {' '.join(map(str, face))}" for face in _FACES]
    return "\n".join([f"o {link}", *corners, *faces, ""])


def urdf(*, has_arm: bool = False) -> str:
    """The nominal robot; meshes are those that ``GetRobotLinkModel`` gives."""
    parts = ['<robot name="spot">', _link(BASE, facts.BODY)]
    for leg in facts.LEG_NAMES:
        side, is_right, is_hind = facts.side_sign(leg), facts.side_sign(leg) < 0, facts.end_sign(leg) < 0
        inertias = (
            facts.HIP_FL.mirrored(left_right=is_right, front_hind=is_hind),
            facts.UPPER_LEG_FL.mirrored(left_right=is_right),
            facts.LOWER_LEG_FL.mirrored(left_right=is_right),
        )
        x, y, z = facts.HX_FROM_BODY_M
        hy_m = (0.0, side * facts.HY_FROM_HX_M[1], 0.0)
        places_m = ((facts.end_sign(leg) * x, side * y, z), hy_m, facts.KN_FROM_HY_M)
        parent = BASE
        for joint, part, place_m, inertia in zip(facts.JOINT_TYPES, _OF_LEG, places_m, inertias, strict=True):
            child = f"{leg}.{part}"
            index, axis = facts.JOINT_NAMES.index(f"{leg}_{joint}"), (1, 0, 0) if joint == "hx" else (0, 1, 0)
            limits = facts.POSITION_LOW_RAD[index], facts.POSITION_HIGH_RAD[index]
            parts += [_link(child, inertia), _joint(f"{leg}.{joint}", parent, child, place_m, axis, limits)]
            parent = child
    parent = BASE
    for i, (child, inertia) in enumerate(ARM_LINKS.items() if has_arm else ()):
        name, limits = arm.ARM_JOINT_NAMES[i].replace("_", "."), (arm.ARM_LOW_RAD[i], arm.ARM_HIGH_RAD[i])
        parts += [_link(child, inertia), _joint(name, parent, child, arm.ARM_PLACES_M[i], arm.ARM_AXES[i], limits)]
        parent = child
    return "\n".join([*parts, "</robot>", ""])


def _link(name: str, inertia: facts.LinkInertia) -> str:
    moments = zip(("ixx", "iyy", "izz", "ixy", "ixz", "iyz"), inertia.inertia_kg_m2, strict=True)
    return f"""  <link name="{name}">
    <inertial><origin xyz="{_text(inertia.com_m)}"/><mass value="{inertia.mass_kg!r}"/>
      <inertia {" ".join(f'{axis}="{value!r}"' for axis, value in moments)}/></inertial>
    <visual><geometry><mesh filename="{name}.obj"/></geometry></visual>
  </link>"""


def _joint(name: str, parent: str, child: str, place_m: _Vector, axis: _Vector, limits_rad: tuple[float, float]) -> str:
    low, high = map(float, limits_rad)
    return f"""  <joint name="{name}" type="revolute">
    <origin xyz="{_text(place_m)}"/><axis xyz="{_text(axis)}"/><parent link="{parent}"/><child link="{child}"/>
    <limit lower="{low!r}" upper="{high!r}" effort="1000" velocity="1000"/>
  </joint>"""


def _text(vector: _Vector) -> str:
    return " ".join(repr(float(value)) for value in vector)


STATE_STREAM = "/bosdyn.api.RobotStateStreamingService/GetRobotStateStream"


class RobotStateService(Service):
    """Power, batteries, faults, e-stops, kinematics, feet: what the stream does not carry."""

    modules = (robot_state_service_pb2,)

    def __init__(self, world: World) -> None:
        super().__init__()
        self._world = world
        self._has_arm = bool(world.robot.snapshot().arm.size)

    def GetRobotState(self, request: Any, response: Any) -> None:  # noqa: N802
        """The state of one instant."""
        world, state = self._world, response.robot_state
        fill_state(
            state, world.robot.snapshot(), is_wifi_on=world.is_wifi_on, are_payload_ports_on=world.are_payload_ports_on
        )
        state.service_fault_state.CopyFrom(world.service_faults.state())

    def GetRobotMetrics(self, request: Any, response: Any) -> None:  # noqa: N802
        """Distance and times since the fake was started."""
        snapshot, told = self._world.robot.snapshot(), response.robot_metrics
        told.timestamp.CopyFrom(timestamp_from_ns(snapshot.robot_stamp_ns))
        told.metrics.add(label="distance", units="m", float_value=snapshot.distance_m)
        for label, seconds in (("time moving", snapshot.time_moving_s), ("electric power", snapshot.time_powered_s)):
            told.metrics.add(label=label, units="s").duration.FromNanoseconds(round(seconds * 1e9))

    def GetRobotHardwareConfiguration(self, request: Any, response: Any) -> None:  # noqa: N802
        """The links and a URDF, of our own numbers: the vendor's URDF and meshes are not ours to give out."""
        hardware = response.hardware_configuration
        for name in link_names(has_arm=self._has_arm):
            hardware.skeleton.links.add(name=name)
        hardware.skeleton.urdf = urdf(has_arm=self._has_arm)
        for what in ("off_robot", "cycle_robot", "payload_ports", "wifi_radio"):
            setattr(hardware, f"can_power_command_request_{what}", True)

    def GetRobotLinkModel(self, request: Any, response: Any) -> None:  # noqa: N802
        """A link's outline: a box."""
        name = request.link_name
        names = link_names(has_arm=self._has_arm)
        if name not in names:
            refuse(response, f"no model of link {name!r}; links: {', '.join(names)}")
            return
        response.link_model.file_name, response.link_model.file_contents = f"{name}.obj", outline_obj(name)


def stream_handler(world: World) -> grpc.GenericRpcHandler:
    """The state stream. Messages arrive here as bytes, so nothing is serialised twice."""

    def stream(_: robot_state_pb2.RobotStateStreamRequest, context: grpc.ServicerContext) -> Iterator[bytes]:
        subscription = world.robot.subscribe_state()
        forget = world.link.listen("state", subscription.close)
        if not context.add_callback(subscription.close):
            subscription.close()
        try:
            while not subscription.is_closed:
                message = subscription.get(0.5)
                if message is not None:
                    yield message
        finally:
            forget()
            subscription.close()
        if context.is_active():
            context.abort(grpc.StatusCode.UNAVAILABLE, world.link.why_down() or "the robot ended the state stream")

    handler: grpc.RpcMethodHandler[Any, Any] = grpc.unary_stream_rpc_method_handler(
        stream, request_deserializer=robot_state_pb2.RobotStateStreamRequest.FromString, response_serializer=None
    )
    service, _, method = STATE_STREAM.lstrip("/").rpartition("/")
    return grpc.method_handlers_generic_handler(service, {method: handler})
