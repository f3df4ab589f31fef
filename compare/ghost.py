"""One MCAP file for Foxglove: the robot, a ghost Spot of each other run beside it, and their differences by joint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from foxglove_schemas_protobuf.FrameTransform_pb2 import FrameTransform
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.JointStates_pb2 import JointStates
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.Odometry_pb2 import Odometry
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf.message import Message

from compare.cause import Cause
from compare.differences import Differences
from compare.tracks import STEP_S, Track
from spot_log.format.codec import Topic
from spot_log.format.viewer import BODY_FRAME, ODOM_FRAME, joint_states, odometry, spot_scene, timestamp, transforms
from spot_log.write.mcap_file import CHUNK_BYTES, McapFile
from spot_model.robot import facts
from spot_model.robot.facts import Array
from spot_model.robot.rotation import multiply_wxyz, rotate_wxyz, yaw_rad
from spot_protos import log_pb2

EVERY: Final = 2
"""Samples of the grid to a message: 50 a second."""
TINTS: Final = ((0.35, 0.65, 1.0), (0.35, 0.9, 0.6), (0.9, 0.5, 0.9))


def write_ghosts(
    path: Path, tracks: Sequence[Track], found: Sequence[Differences], causes: Sequence[Cause], beside_m: float
) -> None:
    """Write the file.

    Args:
        path: Where to; never overwritten.
        tracks: Aligned runs, the reference first. Ghosts start where the reference starts, in its direction.
        found: Differences of each other run from the reference.
        causes: Stretches of the reference that a diagnosis names.
        beside_m: How far to the left of the robot each ghost runs; 0 puts them into it.

    Raises:
        LogExistsError: The file exists.
        OSError: It cannot be written.
    """
    topics = _topics(len(tracks) - 1)
    channels = {topic.name: topic.channel_id for topic in topics}
    file = McapFile(path, topics)
    counts = dict.fromkeys(channels, 0)
    try:
        for stamp_ns, name, message in _messages(tracks, found, causes, beside_m):
            data = message.SerializeToString()
            file.add(channels[name], data, log_ns=stamp_ns, publish_ns=stamp_ns, sequence=counts[name])
            counts[name] += 1
            if file.buffered_bytes >= CHUNK_BYTES:
                file.flush()
        file.finish()
    except BaseException:
        file.give_up()
        raise


def prefix(index: int) -> str:
    """Beginning of a ghost's frames and topics; the first other run has index 0."""
    return "ghost" if index == 0 else f"ghost{index + 1}"


def _topics(n_ghosts: int) -> tuple[Topic, ...]:
    kinds = {"/tf": FrameTransforms, "/scene": SceneUpdate, "/joint_states": JointStates, "/odometry": Odometry}
    names: list[tuple[str, type[Message]]] = [*kinds.items(), ("/command", Odometry), ("/log", Log)]
    for i in range(n_ghosts):
        names += [(f"/{prefix(i)}{name}", kinds[name]) for name in ("/joint_states", "/odometry")]
        names.append((f"/{prefix(i)}/difference", JointStates))
    return tuple(Topic(i, name, kind) for i, (name, kind) in enumerate(names, start=1))


def _messages(
    tracks: Sequence[Track], found: Sequence[Differences], causes: Sequence[Cause], beside_m: float
) -> Iterator[tuple[int, str, Message]]:
    reference = tracks[0]
    placed = [placed_beside(track, reference, beside_m * i) for i, track in enumerate(tracks)]
    waiting = sorted(causes, key=lambda cause: cause.start_s)
    for row in range(0, len(reference), EVERY):
        stamp_ns = int(reference.stamp_ns[row])
        while waiting and waiting[0].start_s <= row * STEP_S:
            cause = waiting.pop(0)
            yield stamp_ns, "/log", Log(timestamp=timestamp(stamp_ns), level=Log.Level.WARNING, message=cause.text)
        frames: list[FrameTransform] = []
        for i, (track, at) in enumerate(zip(tracks, placed, strict=True)):
            start = "" if i == 0 else f"{prefix(i - 1)}/"
            state = _state(track, at, row)
            moved = transforms(state, stamp_ns).transforms
            frames += [_renamed(t, start) for t in moved]
            yield stamp_ns, f"/{start}joint_states", joint_states(state, facts.JOINT_NAMES, stamp_ns)
            yield stamp_ns, f"/{start}odometry", odometry(state, stamp_ns)
            if i:
                difference = _difference(found[i - 1], row)
                yield stamp_ns, f"/{start}difference", joint_states(difference, facts.JOINT_NAMES, stamp_ns)
        yield stamp_ns, "/tf", FrameTransforms(transforms=frames)
        yield stamp_ns, "/command", _command(reference, row, stamp_ns)
        if row % 100 == 0:
            yield stamp_ns, "/scene", _scene(len(tracks) - 1, stamp_ns)


def placed_beside(track: Track, reference: Track, beside_m: float) -> tuple[Array, Array]:
    """Positions and attitudes of a body that starts where the reference does; shapes (n, 3) and (n, 4)."""
    heading = float(yaw_rad(reference.odom_from_body_wxyz[0]))
    turn = heading - float(yaw_rad(track.odom_from_body_wxyz[0]))
    turn_wxyz = np.array([[np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)]])
    moved = rotate_wxyz(turn_wxyz, track.position_of_body_in_odom_m - track.position_of_body_in_odom_m[0])
    left = beside_m * np.array([-np.sin(heading), np.cos(heading), 0.0])
    turned = multiply_wxyz(turn_wxyz, track.odom_from_body_wxyz)
    return reference.position_of_body_in_odom_m[0] + moved + left, np.asarray(turned)


def _state(track: Track, place: tuple[Array, Array], row: int) -> log_pb2.State:
    linear = rotate_wxyz(place[1][row], np.array([*track.body_velocity[row, :2], 0.0]))
    return log_pb2.State(
        position_rad=track.position_rad[row].tolist(),
        velocity_rad_s=track.velocity_rad_s[row].tolist(),
        load_nm=track.load_nm[row].tolist(),
        position_of_body_in_odom_m=place[0][row].tolist(),
        odom_from_body_wxyz=place[1][row].tolist(),
        linear_vel_of_body_in_odom_m_s=linear.tolist(),
        angular_vel_of_body_in_odom_rad_s=[0.0, 0.0, float(track.body_velocity[row, 2])],
    )


def _difference(found: Differences, row: int) -> log_pb2.State:
    """Other less reference, as a state: positions, velocities, and loads, which become efforts."""
    names = ("position_rad", "velocity_rad_s", "load_nm")
    return log_pb2.State(**{name: found.signals[name].over_time[row].tolist() for name in names})


def _command(reference: Track, row: int, stamp_ns: int) -> Odometry:
    """The commanded velocity, in the form in which the measured one is given, so that one plot shows both."""
    message = Odometry(timestamp=timestamp(stamp_ns), frame_id=ODOM_FRAME, body_frame_id=BODY_FRAME)
    v_x, v_y, yaw_rate = np.nan_to_num(reference.velocity_command[row])
    message.linear_velocity.x, message.linear_velocity.y, message.angular_velocity.z = v_x, v_y, yaw_rate
    return message


def _renamed(transform: FrameTransform, start: str) -> FrameTransform:
    transform.child_frame_id = start + transform.child_frame_id
    if transform.parent_frame_id != ODOM_FRAME:
        transform.parent_frame_id = start + transform.parent_frame_id
    return transform


def _scene(n_ghosts: int, stamp_ns: int) -> SceneUpdate:
    scene = spot_scene(stamp_ns)
    for i in range(n_ghosts):
        ghost = spot_scene(stamp_ns)
        for entity in ghost.entities:
            entity.frame_id, entity.id = f"{prefix(i)}/{entity.frame_id}", f"{prefix(i)}/{entity.id}"
            shapes: list[Any] = [*entity.cubes, *entity.spheres, *entity.cylinders]
            for shape in shapes:
                shape.color.r, shape.color.g, shape.color.b = TINTS[i % len(TINTS)]
                shape.color.a = 0.45
        scene.entities.extend(ghost.entities)
    return scene
