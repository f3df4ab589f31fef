#!/usr/bin/env bash
# tensorboard 2.21.0: EventAccumulator gives back at most 10,000 points of a curve, drawn at random, without a word.
#
# A training of 12,000 iterations writes 12,000 rewards. Scalars("reward") has 10,000 of them: the last is always
# there, the others are a random sample whose seed is fixed, so gaps of several iterations stand in a list that looks
# complete. Means over windows of 100 entries then span other numbers of iterations, early and late.
# Whoever evaluates curves: size_guidance={"scalars": 0} keeps all.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet "tensorboard==2.21.0" "numpy==2.4.6"
"$folder/venv/bin/python" - <<'PY'
import tempfile
from importlib.metadata import version

from tensorboard.backend.event_processing.event_accumulator import EventAccumulator
from tensorboard.compat.proto.event_pb2 import Event
from tensorboard.compat.proto.summary_pb2 import Summary
from tensorboard.summary.writer.event_file_writer import EventFileWriter

assert version("tensorboard") == "2.21.0"
N = 12_000
with tempfile.TemporaryDirectory() as folder:
    writer = EventFileWriter(folder)
    for step in range(N):
        summary = Summary(value=[Summary.Value(tag="reward", simple_value=float(step))])
        writer.add_event(Event(step=step, wall_time=float(step), summary=summary))
    writer.close()

    def steps_of(**options):
        accumulator = EventAccumulator(folder, **options)
        accumulator.Reload()
        return [scalar.step for scalar in accumulator.Scalars("reward")]

    steps, again = steps_of(), steps_of()
    gaps = [after - before for before, after in zip(steps, steps[1:])]
    print(f"{N} points were written, {len(steps)} are read; up to {max(gaps) - 1} in a row are missing")
    assert len(steps) == 10_000 and steps == again and steps == sorted(set(steps))
    assert steps[-1] == N - 1 and max(gaps) > 2
    assert steps_of(size_guidance={"scalars": 0}) == list(range(N))
PY
