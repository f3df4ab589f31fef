"""Claim: a log is read into arrays within three times the time of HDF5, in a fifth of the mcap package's or less.

The log holds the messages of one run against the fake robot again and again, with stamps that go on, as `RunWriter`
writes them. HDF5 holds the same arrays of states, packets, commands and ticks, appended a second at a time, and in one
piece; the mcap package's reader decodes each message with protobuf. Medians; the first round does not count.

    python lab/benchmarks/log_reading.py [--minutes 10] [--rounds 5]
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import h5py
import numpy as np
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from fake_robot.start.process import FakeProcess
from spot_log import open_run, read_run
from spot_log.format.codec import COMMAND, HEADER, SLOW_STATE, STATE, TICK
from spot_log.format.tables import CommandTable, ImuTable, StateTable, TickTable
from spot_log.read.mcap_scan import scan_mcap
from spot_log.write.run_writer import RunWriter

KINDS = {"state": (StateTable, 333), "imu": (ImuTable, 1000), "command": (CommandTable, 50), "tick": (TickTable, 50)}
Arrays = dict[str, np.ndarray]


def write_log(folder: Path, log: Path, minutes: float) -> None:
    """Run for 20 s in lock-step, and write the messages until they are that long."""
    with FakeProcess(is_lock_step=True) as fake:
        words = ["run", "--robot", fake.address.robot, "--lock-step", fake.address.admin, "--policy", "walk"]
        words += ["--duration", "20", "--log-dir", str(folder)]
        environment = {**os.environ, **fake.address.environment}
        subprocess.run([sys.executable, "-m", "spot_model", *words], env=environment, check=True, capture_output=True)  # noqa: S603 - our own
    scan = scan_mcap(next(folder.glob("*.mcap")).read_bytes())
    types = {topic.name: topic.message_type for topic in (STATE, COMMAND, TICK, SLOW_STATE)}
    messages = [(m.topic, types[m.topic].FromString(m.data)) for m in scan.messages if m.topic in types]
    stamps = [message.robot_stamp_ns for name, message in messages if name == STATE.name]
    span_ns, sequence = stamps[-1] - stamps[0] + 3_000_000, dict.fromkeys(types, 0)
    writer = RunWriter(log, HEADER.message_type.FromString(scan.of(HEADER.name).data()[0]))
    for _ in range(max(1, round(minutes * 60e9 / span_ns))):
        for name, message in messages:
            for field in [field.name for field, _ in message.ListFields() if field.name.endswith("_stamp_ns")]:
                setattr(message, field, getattr(message, field) + span_ns)
            writer.add(message, sequence[name])
            sequence[name] += 1
            if name == STATE.name and sequence[name] % 166 == 0:  # twice a second, as a run
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
    """Every field of every message."""
    rows = {name: [] for name in KINDS}
    with log.open("rb") as file:
        topics = [STATE.name, COMMAND.name, TICK.name]
        for found in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages(topics=topics):
            rows[found.channel.topic[1:]].append(found.decoded_message)
    rows["imu"] = [packet for state in rows["state"] for packet in state.imu]
    arrays = {}
    for name, column in ((name, c) for name, (kind, _) in KINDS.items() for c in kind.columns()):
        if column not in ("sequence", "state_index"):  # no fields of a message
            values = [getattr(row, column) for row in rows[name]]
            width = 0 if np.isscalar(values[0]) else max(map(len, values))
            arrays[f"{name}/{column}"] = np.array([list(v) or [np.nan] * width for v in values] if width else values)
    return arrays


def store(arrays: Arrays, file: Path, *, is_appended: bool) -> None:
    """Write arrays to HDF5, texts as bytes."""
    with h5py.File(file, "w") as out:
        for name, given in arrays.items():
            values, step = given.astype("S") if given.dtype.kind == "U" else given, KINDS[name.split("/")[0]][1]
            first = values[:step] if is_appended else values
            data = out.create_dataset(name, data=first, maxshape=(None, *values.shape[1:]) if is_appended else None)
            for at in range(len(first), len(values), step):
                data.resize(min(at + step, len(values)), axis=0)
                data[at : at + step] = values[at : at + step]


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=5)
    chosen, told = parser.parse_args(), {"cores": os.cpu_count()}
    with tempfile.TemporaryDirectory() as folder:
        log, appended, whole = (Path(folder) / name for name in ("long.log", "appended.h5", "whole.h5"))
        write_log(Path(folder), log, chosen.minutes)
        arrays = by_read_run(log)
        told["arrays_mb"] = round(sum(array.nbytes for array in arrays.values()) / 1e6, 1)
        for file in (appended, whole):
            store(arrays, file, is_appended=file == appended)
        readers = {"opened": (open_run, log), "ours": (by_read_run, log), "mcap": (by_mcap, log)}
        for name, (read, file) in {**readers, "hdf5": (by_hdf5, appended), "hdf5_whole": (by_hdf5, whole)}.items():
            times = []
            for _ in range(2 if name == "mcap" else chosen.rounds + 1):
                began = time.perf_counter(), time.process_time()
                read(file)
                times.append((time.perf_counter() - began[0], time.process_time() - began[1]))
            wall_s, processor_s = (round(statistics.median(part), 3) for part in zip(*times[1:], strict=True))
            told[name] = {"s": wall_s, "processor_s": processor_s, "mb": round(file.stat().st_size / 1e6, 1)}
    print(json.dumps(told))


if __name__ == "__main__":
    main()
