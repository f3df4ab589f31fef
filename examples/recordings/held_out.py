"""Predict one half of a recording from the other: pieces of four seconds, odd ones diagnosed, even ones predicted.

    python examples/recordings/held_out.py go2 aliengo z1

A row for each: the joints' error under the commands, mrad, for 1 s at a time, with rigid bodies alone and with the
diagnosis's drives; and the delay that was found, ms.
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np

import spot_rl
from diagnosis.read import fixed_base
from diagnosis.read.robot_file import load_robot
from diagnosis.session import DiagnosisProgress, DiagnosisRequest, run_session
from spot_log.importing import import_log, load_mapping

HERE = Path(__file__).parent
PIECE_S = 4.0

if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="+", help="recordings whose data are NPZ files in data/")
    for name in parser.parse_args().names:
        arrays = dict(np.load(HERE / "data" / f"{name}.npz"))
        robot_file = HERE / f"{name}_robot.yaml"
        mapping, robot = load_mapping(HERE / f"{name}.yaml"), load_robot(robot_file)
        time_s = arrays["time"].ravel()
        with tempfile.TemporaryDirectory() as folder:
            place, logs = Path(folder), []
            for k in range(int(time_s[-1] // PIECE_S)):
                rows = (time_s >= k * PIECE_S) & (time_s < (k + 1) * PIECE_S)
                file = place / f"{k}.npz"
                np.savez(file, **{key: a[rows] if len(a) == len(rows) else a for key, a in arrays.items()})
                logs.append(place / f"{k}.mcap")
                import_log(mapping.model_copy(update={"command_sequence": f"piece {k}"}), file, logs[-1])
            inputs = DiagnosisRequest(logs=tuple(map(str, logs[::2])), nominal="ideal")
            with DiagnosisProgress() as say:
                run_session(inputs, place / "found", say, robot_file=robot_file)
            found = fixed_base.Drives.of(load_robot(place / "found" / "corrected_robot.yaml"))
            none = fixed_base.Drives(*np.zeros((4, len(robot.joint_names))))
            told = []
            for drives in (none, found):
                errors = [fixed_base.error_rad(robot, spot_rl.read_run(log), drives) for log in logs[1::2]]
                told.append(f"{1e3 * float(np.mean(errors)):.2f}")
        print(f"| {name} | {' | '.join(told)} | {1e3 * found.delay_s:.0f} |")
