"""How many planted errors the conformance suite finds.

Each error of ``proof.planted`` is planted alone, in a server that passes every call on to a fake robot.

    python lab/benchmarks/conformance_errors.py [--with-motion] [--source SOURCE] [NAME ...]

Errors that show only in motion are planted with --with-motion alone. The last number of a line is how many checks could
not be judged.

Claim: docs/evidence/programs.md, "Errors that the conformance suite finds".
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections import defaultdict
from pathlib import Path

from fake_robot.conformance.check import CheckOutcome, Needs
from fake_robot.conformance.command import connect, run_checks
from fake_robot.robot.robot import Robot
from fake_robot.scenario.scenario import scenario_from_data
from fake_robot.services.auth import Credentials
from fake_robot.start.certificates import make_certificates
from fake_robot.start.server import FakeServer
from proof.planted.errors import ERRORS
from proof.planted.server import RIGHT, PlantedServer

SCENARIO = {
    "power": {"power_on_s": 0.3, "power_off_s": 0.1},
    "motion": {"stand_s": 0.8, "sit_s": 0.8},
    "joint_control": {"activation_wait_s": 0.2},
    "services": {"cameras": "test_card"},
}


def main(words: list[str] | None = None) -> None:
    """Print a line for each error, then the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*")
    parser.add_argument("--with-motion", action="store_true")
    parser.add_argument("--source", help="outside, named, sibling or own")
    given = parser.parse_args(words)
    asked_for = [e for e in ERRORS.values() if given.source in {None, e.source}]
    shown = [RIGHT, *(e for e in asked_for if given.with_motion or not e.needs_motion)]
    errors = [ERRORS[name] for name in given.names] or shown
    allowed = Needs.MOTION if given.with_motion else Needs.LEASE
    missed, counts = [], defaultdict[str, list[int]](lambda: [0, 0])
    with tempfile.TemporaryDirectory() as folder:
        certificates = make_certificates(Path(folder))
        for error in errors:
            start_s = time.monotonic()
            scenario = scenario_from_data(SCENARIO)
            fake = FakeServer(Robot(scenario), scenario.services, Credentials("user", "horse"), certificates)
            robot = fake.start().robot
            with PlantedServer(robot, certificates) as server:
                server.plant(error)
                found, n_open = _found(server.address, certificates.ca_path, allowed)
            fake.stop()
            took_s = time.monotonic() - start_s
            print(
                f"{took_s:5.1f} s  {error.source:8}{error.name:34}{'; '.join(found)[:200] or '-'}  open: {n_open}",
                flush=True,
            )
            if error is not RIGHT:
                counts[error.source][0] += bool(found)
                counts[error.source][1] += 1
                missed += [] if found else [error.name]
    print({source: f"{hit} of {of}" for source, (hit, of) in counts.items()}, "missed:", missed)


def _found(address: str, ca_file: Path, allowed: Needs) -> tuple[list[str], int]:
    os.environ |= {"BOSDYN_CLIENT_USERNAME": "user", "BOSDYN_CLIENT_PASSWORD": "horse"}
    suite = connect(address, ca_file)
    results = list(run_checks(suite, allowed))
    found = [f"{r.check.name}: {r.seen}" for r in results if r.verdict is CheckOutcome.FAIL]
    return found, sum(r.verdict is CheckOutcome.OPEN for r in results)


if __name__ == "__main__":
    main()
