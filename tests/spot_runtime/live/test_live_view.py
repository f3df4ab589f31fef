"""The live view over its own WebSocket: channels, schemas, messages; and clients that never read."""

from __future__ import annotations

import base64
import os
import select
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from google.protobuf import descriptor_pool
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from spot_log.format.codec import ALL_TOPICS, SCENE, STATE, TICK
from spot_log.format.records import EventRecord, RunHeader, Severity
from spot_log.write.live_process import FOLDER_PREFIX, SOCKET_NAME, LiveProcess, LiveViewError
from spot_log.write.live_tap import SOCKET_VARIABLE, LiveTap
from spot_log.write.logger_process import LoggerProcess
from spot_model.process.private_folder import make_private_folder
from spot_protos import log_pb2
from tests.spot_runtime.live.viewer import Viewer

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000


@pytest.fixture
def live() -> Iterator[LiveProcess]:
    with LiveProcess(0) as process:
        yield process
    assert SOCKET_VARIABLE not in os.environ


def test_what_a_killed_service_left_is_cleared_away_and_nothing_else(tmp_path: Path) -> None:
    def listener_in(name: str) -> socket.socket:
        (tmp_path / name).mkdir()
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        listener.bind(str(tmp_path / name / SOCKET_NAME))
        listener.listen(4)
        return listener

    of = (FOLDER_PREFIX, SOCKET_NAME, socket.SOCK_SEQPACKET)
    listener_in("spot-rl-live-left").close()
    listener_in("another").close()
    (tmp_path / "spot-rl-live-begun").mkdir()
    with listener_in("spot-rl-live-in-use"):
        made = make_private_folder({"XDG_RUNTIME_DIR": str(tmp_path)}, *of)
    names = sorted(path.name for path in tmp_path.iterdir() if path != made)
    assert names == ["another", "spot-rl-live-begun", "spot-rl-live-in-use"]
    assert made.parent == tmp_path
    elsewhere = make_private_folder({"RUNTIME_DIRECTORY": str(tmp_path / "none")}, *of)
    assert elsewhere.parent == Path(tempfile.gettempdir())
    elsewhere.rmdir()


def test_channels_are_the_log_s_with_whole_schemas(live: LiveProcess) -> None:
    viewer = Viewer(live.url)
    found = {c["topic"]: c for c in viewer.channels.values()}
    viewer.close()
    # The SDK does not advertise what has no schema data it can read, so all of them count.
    assert set(found) == {topic.name for topic in ALL_TOPICS}
    for topic in ALL_TOPICS:
        channel = found[topic.name]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("protobuf", "protobuf")
        assert channel["schemaName"] == topic.schema_name

        files = FileDescriptorSet.FromString(base64.b64decode(channel["schema"]))
        pool = descriptor_pool.DescriptorPool()
        for file in files.file:
            pool.Add(file)  # type: ignore[no-untyped-call]
        assert pool.FindMessageTypeByName(channel["schemaName"]).full_name == topic.schema_name


def test_what_is_logged_is_seen(live: LiveProcess, tmp_path: Path, make_state: Any) -> None:
    viewer = Viewer(live.url)
    sink = LoggerProcess.start(tmp_path / "run.mcap", RunHeader("id", START_NS))
    for i in range(70):
        sink.put(make_state(START_NS + i * 3 * MS))
    sink.put(EventRecord(START_NS, START_NS, Severity.WARNING, "state_old", "an event"))
    seen: dict[str, list[tuple[int, bytes]]] = {}
    for topic, stamp_ns, data in viewer.messages():
        seen.setdefault(topic, []).append((stamp_ns, data))
        if "/event" in seen and len(seen.get("/tf", [])) >= 10 and "/scene" in seen:
            break
    viewer.close()
    sink.close("completed")
    assert len(SceneUpdate.FromString(seen["/scene"][0][1]).entities) == 13
    frames = FrameTransforms.FromString(seen["/tf"][0][1])
    assert [t.child_frame_id for t in frames.transforms][:2] == ["body", "fl_hx"]
    assert log_pb2.Event.FromString(seen["/event"][0][1]).text == "an event"
    stamps = [stamp for stamp, _ in seen["/state"]]
    assert len(stamps) <= 11  # 70 states of 3 ms are 210 ms: thinned to 50 a second
    assert stamps == sorted(stamps)


def test_whoever_comes_late_gets_the_model_too(live: LiveProcess, tmp_path: Path) -> None:
    sink = LoggerProcess.start(tmp_path / "run.mcap", RunHeader("id", START_NS))
    viewer = Viewer(live.url)
    wanted = {"/scene", "/header"}
    for topic, _, _ in viewer.messages():
        wanted.discard(topic)
        if not wanted:
            break
    viewer.close()
    sink.close("completed")


def test_a_client_that_never_reads_loses_messages_and_delays_nobody(
    live: LiveProcess, tmp_path: Path, make_state: Any
) -> None:
    lazy = Viewer(live.url)  # from now on it reads nothing
    sink = LoggerProcess.start(tmp_path / "run.mcap", RunHeader("id", START_NS))
    count = 3000
    for i in range(count):
        sink.put(make_state(START_NS + i * 20 * MS))
    other = Viewer(live.url)
    sink.put(EventRecord(START_NS, START_NS, Severity.INFO, "mode", "still here"))
    assert any(topic == "/event" for topic, _, _ in other.messages())
    other.close()
    sink.close("completed")
    assert sink.dropped["state"] == 0
    assert sink.health().unwritten["state"] == 0
    lazy.close()


def test_a_view_that_is_stopped_or_gone_costs_messages_of_the_view_alone(tmp_path: Path, make_state: Any) -> None:
    with LiveProcess(0) as live:
        sink = LoggerProcess.start(tmp_path / "run.mcap", RunHeader("id", START_NS))
        os.kill(live.pid, 19)  # SIGSTOP
        for i in range(2000):
            sink.put(make_state(START_NS + i * 20 * MS))
        os.kill(live.pid, 9)
    for i in range(2000, 2100):
        sink.put(make_state(START_NS + i * 20 * MS))
    sink.close("completed")
    assert sink.dropped["state"] == 0
    assert (tmp_path / "run.mcap").is_file()


def test_the_tap_thins_drops_and_gives_up(tmp_path: Path) -> None:
    assert LiveTap.from_environment({})._socket is None
    assert LiveTap.from_environment({SOCKET_VARIABLE: str(tmp_path / "none")})._socket is None
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    ours.setblocking(False)
    tap = LiveTap(ours)
    for i in range(14):
        tap.put(STATE.channel_id, b"s", START_NS + i * 3 * MS)
    for _ in range(3):
        tap.put(TICK.channel_id, b"t", START_NS)
    taken = 0
    while select.select([theirs], [], [], 0.0)[0]:
        taken += len(theirs.recv(100)) > 0
    assert taken == 2 + 3  # stamps 0 to 39 ms lie in two slots of 20 ms
    for _ in range(100_000):
        tap.put(SCENE.channel_id, b"x" * 100, START_NS)
    assert tap.dropped > 0
    theirs.close()
    tap.put(SCENE.channel_id, b"x", START_NS)
    tap.put(SCENE.channel_id, b"x", START_NS)
    assert tap._socket is None


def test_a_port_that_is_taken_is_said_in_words() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with (
            pytest.raises(LiveViewError, match=f"cannot be served on port {port}: .*; name another port"),
            LiveProcess(port),
        ):
            pass
