"""From a log to all arrays of its states, packets, commands and ticks: `read_run`, HDF5, and the mcap package's reader.

The log holds the messages of one real run again and again, their stamps moved on, as the project's own writer writes
them. HDF5 holds the same arrays twice: appended a second at a time, as a logger would, and in one piece. Medians.

    python benchmarks/log_reading.py LOG [--minutes 10] [--rounds 5] [--command-a-state]
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from spot_log import read_run
from spot_log.format.codec import COMMAND, HEADER, SLOW_STATE, STATE, TICK
from spot_log.format.tables import CommandTable, ImuTable, StateTable, Table, TickTable
from spot_log.read.mcap_scan import scan_mcap
from spot_log.write.run_writer import RunWriter

PER_S = {"state": 333, "imu": 1000, "command": 50, "tick": 50}
KINDS: dict[str, type[Table]] = {"state": StateTable, "imu": ImuTable, "command": CommandTable, "tick": TickTable}
Arrays = dict[str, np.ndarray[Any, Any]]


def write_log(source: Path, log: Path, minutes: float, *, is_command_a_state: bool) -> None:
    """Write the messages of ``source`` again and again, until they are that long."""
    scan = scan_mcap(source.read_bytes())
    types = {topic.name: topic.message_type for topic in (STATE, COMMAND, TICK, SLOW_STATE)}
    messages = [(m.topic, types[m.topic].FromString(m.data)) for m in scan.messages if m.topic in types]
    stamps = [message.robot_stamp_ns for name, message in messages if name == STATE.name]
    span_ns, command = stamps[-1] - stamps[0] + 3_000_000, next(m for n, m in messages if n == COMMAND.name)
    writer = RunWriter(log, HEADER.message_type.FromString(scan.by_topic()[HEADER.name][0].data))
    sequence, times = dict.fromkeys(types, 0), round(minutes * 60e9 / span_ns)
    for _ in range(times):
        for name, message in messages:
            for stamp in [field.name for field, value in message.ListFields() if field.name.endswith("_stamp_ns")]:
                setattr(message, stamp, getattr(message, stamp) + span_ns)
            for topic, one in [(name, message), (COMMAND.name, command)][
                : 1 + (is_command_a_state and name == STATE.name)
            ]:
                writer.add(one, sequence[topic])
                sequence[topic] += 1
            if writer.is_chunk_full or sequence[STATE.name] % 166 == 0:
                writer.flush()
    writer.close({}, "completed")


def by_read_run(log: Path) -> Arrays:
    """Every column of the four tables."""
    run = read_run(log)
    tables = {"state": run.states, "imu": run.states.imu, "command": run.commands, "tick": run.ticks}
    return {f"{name}/{column}": getattr(table, column) for name, table in tables.items() for column in table.columns()}


def by_hdf5(file: Path) -> Arrays:
    """Every data set."""
    with h5py.File(file) as stored:
        return {f"{name}/{column}": stored[name][column][:] for name in stored for column in stored[name]}


def by_mcap(log: Path) -> Arrays:
    """Every message decoded with protobuf, by the mcap package's own reader."""
    rows: dict[str, list[Any]] = {name: [] for name in KINDS}
    with log.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        for _, channel, _, message in reader.iter_decoded_messages(topics=[STATE.name, COMMAND.name, TICK.name]):
            rows[channel.topic[1:]].append(message)
    rows["imu"] = [packet for state in rows["state"] for packet in state.imu]
    arrays: Arrays = {}
    for name, kind in KINDS.items():
        for column in set(kind.columns()) - {"sequence", "state_index"}:  # no fields of a message
            values = [getattr(row, column) for row in rows[name]]
            width = 0 if np.isscalar(values[0]) else max(len(value) for value in values)
            arrays[f"{name}/{column}"] = np.array([list(v) or [np.nan] * width for v in values] if width else values)
    return arrays


def store(arrays: Arrays, file: Path, *, is_appended: bool) -> None:
    """Write arrays to HDF5; texts as bytes."""
    with h5py.File(file, "w") as out:
        for name, given in arrays.items():
            values = given.astype("S") if given.dtype.kind == "U" else given
            if not is_appended:
                out[name] = values
                continue
            data, step = (
                out.create_dataset(name, (0, *values.shape[1:]), values.dtype, maxshape=(None, *values.shape[1:])),
                PER_S[name.split("/")[0]],
            )
            for at in range(0, len(values), step):
                data.resize(min(at + step, len(values)), axis=0)
                data[at : at + step] = values[at : at + step]


def seconds_of(call: Callable[[Path], Any], file: Path, rounds: int) -> tuple[float, float]:
    """Median time and processor time of a call, s; the first one, which fills the system's cache, does not count."""
    times = []
    for _ in range(rounds + 1):
        began = time.perf_counter(), time.process_time()
        call(file)
        times.append((time.perf_counter() - began[0], time.process_time() - began[1]))
    return statistics.median(t for t, _ in times[1:]), statistics.median(t for _, t in times[1:])


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("log", type=Path, help="of a real run")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--command-a-state", action="store_true", help="333 commands a second instead of 50")
    chosen = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        log, appended, whole = (Path(folder) / name for name in ("log.mcap", "appended.h5", "whole.h5"))
        write_log(chosen.log, log, chosen.minutes, is_command_a_state=chosen.command_a_state)
        arrays = by_read_run(log)
        for file in (appended, whole):
            store(arrays, file, is_appended=file == appended)
        print(
            f"{platform.node()}, {os.cpu_count()} cores: {sum(a.nbytes for a in arrays.values()) / 1e6:.0f} MB of arrays"
        )
        print(f"{'':24} {'time':>8}   {'processor':>9}   {'file':>8}")
        for name, file, read in (
            ("read_run, opened alone", log, read_run),
            ("read_run, all arrays", log, by_read_run),
            ("HDF5, appended", appended, by_hdf5),
            ("HDF5, in one piece", whole, by_hdf5),
            ("mcap reader, protobuf", log, by_mcap),
        ):
            wall_s, cpu_s = seconds_of(read, file, 1 if read is by_mcap else chosen.rounds)
            print(f"{name:24} {wall_s:8.3f} s {cpu_s:9.3f} s {file.stat().st_size / 1e6:8.1f} MB")


if __name__ == "__main__":
    main()
