"""Claim: the log costs the loop less a message than JSON lines, HDF5 or plain MCAP; and its size.

Every writer gets the states of one fake robot that stands up and sits down at the pace of a robot, 333 a second. Ours
holds the whole message with its IMU packets, and copies for viewers at 50 Hz; plain MCAP (the mcap package's writer,
zstd) the whole message; JSON lines and HDF5 (rows appended to resizable data sets, a second at a time) joints, body and
stamps. How soon a log is read: `lab/benchmarks/log_reading.py`.

    python lab/benchmarks/claims/log.py [--seconds 6]
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from contextlib import closing
from dataclasses import fields
from pathlib import Path
from typing import Protocol

import h5py
import numpy as np
from bosdyn.api.robot_state_pb2 import RobotStateStreamResponse
from mcap.writer import Writer
from mcap_protobuf.schema import build_file_descriptor_set

from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import Scenario
from spot_log.format.records import RunHeader, WireState
from spot_log.format.vendor_state import robot_state_from_wire
from spot_log.write.logger_process import LoggerProcess
from spot_model.robot.facts import NS_PER_S
from spot_model.robot.state import Measured, RobotState

FIELDS = ("robot_stamp_ns", "host_stamp_ns", *(field.name for field in fields(Measured)))
PER_S = 333
N_RECORDED = 10 * PER_S


class Peer(Protocol):
    """One way to keep states; ``put`` is what the loop's thread would call."""

    def put(self, wire: bytes, state: RobotState) -> None:
        """Keep one state."""

    def close(self) -> None:
        """Finish the file."""


class Ours:
    """The log's own process."""

    def __init__(self, path: Path) -> None:
        self._sink = LoggerProcess.start(path, RunHeader("bench", time.time_ns()))

    def put(self, wire: bytes, state: RobotState) -> None:
        """Keep one state."""
        self._sink.put(WireState(wire, state.host_stamp_ns))

    def close(self) -> None:
        """Finish the file."""
        self._sink.close("completed")
        if self._sink.dropped["state"]:
            raise SystemExit(f"our log dropped {self._sink.dropped['state']} states")


class JsonLines:
    """One object a line."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("w")

    def put(self, wire: bytes, state: RobotState) -> None:
        """Keep one state."""
        values = {name: getattr(state, name) for name in FIELDS}
        self._file.write(json.dumps({n: v.tolist() if isinstance(v, np.ndarray) else v for n, v in values.items()}))
        self._file.write("\n")

    def close(self) -> None:
        """Finish the file."""
        self._file.close()


class Hdf5:
    """A data set a field."""

    def __init__(self, path: Path) -> None:
        self._file, self._rows = h5py.File(path, "w"), []

    def put(self, wire: bytes, state: RobotState) -> None:
        """Keep one state."""
        self._rows.append([getattr(state, name) for name in FIELDS])
        if len(self._rows) == PER_S:
            self._flush()

    def _flush(self) -> None:
        for name, column in zip(FIELDS, zip(*self._rows, strict=True), strict=True):
            rows = np.array(column)
            if name not in self._file:
                self._file.create_dataset(name, (0, *rows.shape[1:]), rows.dtype, maxshape=(None, *rows.shape[1:]))
            data = self._file[name]
            data.resize(len(data) + len(rows), axis=0)
            data[-len(rows) :] = rows
        self._file.flush()
        self._rows.clear()

    def close(self) -> None:
        """Finish the file."""
        if self._rows:
            self._flush()
        self._file.close()


class PlainMcap:
    """The mcap package's writer in the loop's process."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._writer, self._n = Writer(self._file), 0
        self._writer.start()
        kind = RobotStateStreamResponse.DESCRIPTOR
        data = build_file_descriptor_set(RobotStateStreamResponse).SerializeToString()
        schema = self._writer.register_schema(kind.full_name, "protobuf", data)
        self._channel = self._writer.register_channel("/state", "protobuf", schema)

    def put(self, wire: bytes, state: RobotState) -> None:
        """Keep one state."""
        self._writer.add_message(self._channel, state.host_stamp_ns, wire, state.robot_stamp_ns, self._n)
        self._n += 1

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()
        self._file.close()


PEERS: dict[str, Callable[[Path], Peer]] = {
    "ours": Ours,
    "json_lines": JsonLines,
    "hdf5": Hdf5,
    "plain_mcap": PlainMcap,
}


def recorded() -> list[bytes]:
    """Ten seconds of states of a robot that stands up and sits down."""
    robot = Robot(Scenario(time_mode="lock_step"))
    robot.power_on()
    robot.advance(round(2.1 * NS_PER_S))
    states = robot.subscribe_state()
    while (left := N_RECORDED - robot.states_sent) > 0:
        robot.stand() if robot.states_sent // 700 % 2 else robot.sit()
        robot.advance_states(min(left, 700))
    return [wire for _ in range(N_RECORDED - 800) if (wire := states.get(0.0)) is not None]


def cost_us(put: Callable[[bytes, RobotState], None], wires: list[bytes], seconds: float) -> dict[str, float]:
    """Cost of one message at a robot's pace."""
    states = [robot_state_from_wire(wire, time.time_ns()) for wire in wires]
    times_us, begin_s = [], time.monotonic()
    for i in range(round(seconds * PER_S)):
        time.sleep(max(0.0, begin_s + i / PER_S - time.monotonic()))
        now_s = time.perf_counter()
        put(wires[i % len(wires)], states[i % len(wires)])
        times_us.append((time.perf_counter() - now_s) * 1e6)
    p50, p99, worst = np.percentile(times_us, (50, 99, 100))
    return {"cost_us_p50": p50, "cost_us_p99": p99, "cost_us_max": worst}


def main() -> None:
    """Measure every writer, print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=6.0, help="at a robot's pace")
    chosen = parser.parse_args()
    wires = recorded()
    told = {}
    for name, made in PEERS.items():
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "log.mcap"
            with closing(made(path)) as writer:
                figures = cost_us(writer.put, wires, chosen.seconds)
            figures["mb_a_minute"] = path.stat().st_size / 1e6 / chosen.seconds * 60
            told[name] = {key: round(value, 2) for key, value in figures.items()}
    print(json.dumps(told))


if __name__ == "__main__":
    main()
