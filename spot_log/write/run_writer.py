"""Write one run's records to a file: topics, stamps, viewer copies, the header first and the footer last."""

from __future__ import annotations

import errno
import os
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from google.protobuf.message import Message

from spot_log.errors import DiskSpaceError, LogError, LogExistsError
from spot_log.format import codec, viewer
from spot_log.format.codec import (
    ALL_TOPICS,
    ARM,
    COMMAND,
    EVENT,
    EVENT_TEXT,
    FOOTER,
    HEADER,
    JOINT_STATES,
    ODOMETRY,
    OWN_TOPICS,
    SCENE,
    SLOW_STATE,
    STATE,
    TICK,
    TRANSFORMS,
    OwnRecord,
    Topic,
)
from spot_log.format.records import RunHeader
from spot_log.write.mcap_file import CHUNK_BYTES, McapFile
from spot_model.robot.facts import JOINT_NAMES
from spot_protos import log_pb2

ACTIVE_SUFFIX: Final = ".active"
MIN_FREE_BYTES_TO_START: Final = 200_000_000
MIN_FREE_BYTES_TO_WRITE: Final = 20_000_000
HEADER_ATTACHMENT: Final = "spot-rl header"


def active_path(path: Path) -> Path:
    """Name of a log while it is being written."""
    return path.with_name(path.name + ACTIVE_SUFFIX)


def free_path(path: Path) -> Path:
    """The name, or the next one like it that is free: two logs may begin within one second."""
    number, free = 1, path
    while free.exists() or active_path(free).exists():
        number += 1
        free = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return free


def make_log_folder(directory: Path) -> None:
    """Make the folder of the logs where it is missing. Raises LogError: it cannot be made."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise LogError(f"the folder {directory} for logs cannot be made: {error.strerror}; name another") from error


def check_can_start(path: Path, min_free_bytes: int = MIN_FREE_BYTES_TO_START) -> None:
    """Check that a log can be begun at ``path``.

    Raises:
        LogExistsError: The log, or one in the making, is there already.
        DiskSpaceError: There is too little room.
        OSError: There is no such directory.
    """
    for taken in (path, active_path(path)):
        if taken.exists():
            raise LogExistsError(taken)
    free = free_bytes(path.parent)
    if free < min_free_bytes:
        raise DiskSpaceError(path.parent, free, min_free_bytes)


def free_bytes(directory: Path) -> int:
    """Room that is left for this user on the directory's disk."""
    status = os.statvfs(directory)
    return status.f_bavail * status.f_frsize


class RunWriter:
    """Write a run to ``path``; until :meth:`close` its name is ``path`` + ``.active``.

    Log time is the receipt or the instant of the act by the host's clock; publish time is the robot's stamp, mapped to
    the host's clock by the newest command or event that carries both (before one, by the first state); on one topic it
    never goes back.
    ``copy_to`` gets a copy of every message, with the number of its topic and its log time; it must not wait.
    Without ``for_viewers`` the file lacks the copies of the states that only viewers read.

    Raises:
        LogExistsError: The log exists.
        DiskSpaceError: There is too little room.
        OSError: The file cannot be created.
    """

    def __init__(
        self,
        path: Path,
        header: RunHeader | log_pb2.Header,
        *,
        min_free_bytes: int = MIN_FREE_BYTES_TO_START,
        copy_to: Callable[[int, bytes, int], None] | None = None,
        for_viewers: bool = True,
    ) -> None:
        check_can_start(path, min_free_bytes)
        self._copy_to, self._for_viewers = copy_to, for_viewers
        self.path = path
        self.message = codec.header_to_proto(header) if isinstance(header, RunHeader) else header
        self._joint_names = tuple(self.message.joint_names) or JOINT_NAMES
        self._file = McapFile(active_path(path), ALL_TOPICS)
        self._robot_minus_host_ns: int | None = None
        self._viewer_slot = -1
        self._sequences: Counter[int] = Counter()
        self._newest_publish_ns: Counter[int] = Counter()
        self._last_host_stamp_ns = self.message.started_host_stamp_ns
        started_ns = self.message.started_host_stamp_ns
        data = self.message.SerializeToString()
        self._put(HEADER, self.message, 0, started_ns)
        self._is_spot = self._joint_names == JOINT_NAMES
        if self._is_spot:
            self._put(SCENE, viewer.spot_scene(started_ns), 0, started_ns)
        try:
            self._file.flush()
            self._file.attach(HEADER_ATTACHMENT, "application/x-protobuf", data, started_ns)
        except OSError:
            self._file.give_up()
            raise

    @property
    def buffered(self) -> dict[str, int]:
        """Messages that the next flush will write, by topic."""
        return _by_topic(self._file.buffered_counts)

    @property
    def written(self) -> dict[str, int]:
        """Messages in the file, by topic."""
        return _by_topic(self._file.written_counts)

    @property
    def place(self) -> Path | None:
        """Where the file is; None where no name leads to it."""
        return self._file.place

    @property
    def is_chunk_full(self) -> bool:
        """Whether it is time to flush, whatever the clock says."""
        return self._file.buffered_bytes >= CHUNK_BYTES

    def add(self, record: OwnRecord, sequence: int) -> None:
        """Add one record; ``sequence`` counts its topic's messages from 0, lost ones included."""
        self._last_host_stamp_ns = max(self._last_host_stamp_ns, record.host_stamp_ns)
        if isinstance(record, log_pb2.State):
            self._add_state(record, sequence)
            return
        if isinstance(record, (log_pb2.Command, log_pb2.Event)) and record.robot_stamp_ns:
            self._robot_minus_host_ns = record.robot_stamp_ns - record.host_stamp_ns
        if isinstance(record, log_pb2.Event):
            self._put(EVENT, record, sequence, record.host_stamp_ns)
            self._put(EVENT_TEXT, viewer.event_text(record), sequence, record.host_stamp_ns)
        elif isinstance(record, log_pb2.Command):
            self._put(COMMAND, record, sequence, record.host_stamp_ns)
        else:
            topic = TICK if isinstance(record, log_pb2.Tick) else SLOW_STATE
            self._put(topic, record, sequence, record.host_stamp_ns, self._to_host(record))

    def flush(self) -> None:
        """Make everything that was added durable.

        Raises:
            OSError: The disk is full or gone, or the file was deleted; what was buffered is lost and forgotten.
        """
        try:
            free = self._file.free_bytes
            if self._file.buffered_bytes and free < MIN_FREE_BYTES_TO_WRITE:
                raise DiskSpaceError(self.path.parent, free, MIN_FREE_BYTES_TO_WRITE)
            self._check_named()
            self._file.flush()
        finally:
            self._file.discard()

    def close(self, dropped: Mapping[str, int], outcome: str) -> None:
        """Write the footer and the index, and give the file its final name.

        Raises:
            OSError: The disk is full or gone; the file keeps its ``.active`` name and stays readable.
        """
        counts = self._file.written_counts + self._file.buffered_counts
        footer = codec.footer_to_proto(self._last_host_stamp_ns, _by_topic(counts), dropped, outcome)
        self._put(FOOTER, footer, 0, self._last_host_stamp_ns)
        self._check_named()
        self._file.finish(self.path.name)

    def abandon(self) -> None:
        """Close the file as it is on disk, under its ``.active`` name."""
        self._file.close()

    def _check_named(self) -> None:
        if self._file.look() is None:
            raise FileNotFoundError(
                errno.ENOENT, "its file was deleted, or its disk unmounted, while it was being written"
            )

    def _add_state(self, state: log_pb2.State, sequence: int) -> None:
        if self._robot_minus_host_ns is None:
            self._robot_minus_host_ns = state.robot_stamp_ns - state.host_stamp_ns
        acquired_ns = self._to_host(state)
        if state.HasField("arm"):
            self._put(ARM, state.arm, sequence, state.host_stamp_ns, acquired_ns)
            state.ClearField("arm")
        self._put(STATE, state, sequence, state.host_stamp_ns, acquired_ns)
        slot = state.robot_stamp_ns // viewer.VIEWER_PERIOD_NS
        if slot == self._viewer_slot or not self._for_viewers:
            return
        self._viewer_slot = slot
        log_ns = state.host_stamp_ns
        copies: list[tuple[Topic, Message]] = [
            (JOINT_STATES, viewer.joint_states(state, self._joint_names, acquired_ns))
        ]
        if viewer.has_pose(state):
            is_spot = self._is_spot and len(state.position_rad) == len(JOINT_NAMES)
            copies.append((TRANSFORMS, viewer.transforms(state, acquired_ns, is_spot=is_spot)))
            copies.append((ODOMETRY, viewer.odometry(state, acquired_ns)))
        for topic, message in copies:
            self._put(topic, message, self._sequences[topic.channel_id], log_ns, acquired_ns)
            self._sequences[topic.channel_id] += 1

    def _to_host(self, record: log_pb2.State | log_pb2.Tick | log_pb2.SlowState) -> int:
        if self._robot_minus_host_ns is None or not record.robot_stamp_ns:
            return record.host_stamp_ns
        return max(0, record.robot_stamp_ns - self._robot_minus_host_ns)

    def _put(self, topic: Topic, message: Message, sequence: int, log_ns: int, publish_ns: int | None = None) -> None:
        data = message.SerializeToString()
        if self._copy_to is not None:
            self._copy_to(topic.channel_id, data, log_ns)
        # A better estimate of the clocks' difference moves the mapping, which must not turn time back for readers.
        newest_ns = max(self._newest_publish_ns[topic.channel_id], log_ns if publish_ns is None else publish_ns)
        self._newest_publish_ns[topic.channel_id] = newest_ns
        self._file.add(topic.channel_id, data, log_ns=log_ns, publish_ns=newest_ns, sequence=sequence)


def _by_topic(counts: Mapping[int, int]) -> dict[str, int]:
    told = [topic for topic in OWN_TOPICS if topic not in (HEADER, FOOTER, *(() if counts[ARM.channel_id] else (ARM,)))]
    return {topic.name[1:]: counts[topic.channel_id] for topic in told}
