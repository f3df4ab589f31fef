"""Claim: the fake robot's network takes as long as asked, and two cores hold several fakes at 333 states a second.

Delays: a bare gRPC echo (textbook_loop.py) drives fakes in real time whose channels have constant delays; the time
from a state's acquisition to the receipt of its command, less the same without delay, should be what was asked.
Fakes: standing robots in processes of their own, each with one reader of its state stream, until one falls below 99 %.

    python lab/benchmarks/claims/fakes.py
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from bosdyn.client.lease import LeaseClient, LeaseKeepAlive
from bosdyn.client.robot_command import RobotCommandClient, blocking_stand
from bosdyn.client.robot_state import RobotStateStreamingClient
from loop import textbook
from textbook_loop import connect

from fake_robot.start.process import FakeProcess
from proof.loop_bench import robot_beside
from spot_model.policy.built_in import policy_file

ASKED_MS = ((0.0, 0.0), (1.5, 3.0), (5.0, 10.0))
"""Delays of states and of commands."""
STATES_HZ = 1e3 / 3.0
HELD = 0.99


def delays(seconds: float) -> dict[str, float]:
    """Asked and measured, ms."""
    told: dict[str, float] = {}
    chosen = argparse.Namespace(policy=policy_file("walk"), seconds=seconds, plain=False)
    for state_ms, command_ms in ASKED_MS:
        scenario = {
            "schema": "spot-rl/scenario/1",
            "state_channel": {"delay": {"kind": "constant", "delay_s": state_ms / 1e3}},
            "command_channel": {"delay": {"kind": "constant", "delay_s": command_ms / 1e3}},
        }
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "delays.yaml"
            path.write_text(json.dumps(scenario))
            with robot_beside(0, str(path)) as (address, cpus):
                measured = textbook(address, cpus, chosen, "--echo")
        told[f"asked_{state_ms + command_ms:g}_ms"] = measured["state_to_command_ms_p50"]
    base = told["asked_0_ms"]
    error = max(abs(value - base - float(name.split("_")[1])) for name, value in told.items())
    return told | {"largest_error_ms": round(error, 3)}


def standing(stack: ExitStack, folder: Path) -> RobotStateStreamingClient:
    """One more fake that stands, and the client of its states."""
    address = stack.enter_context(FakeProcess(state_dir=folder)).address
    os.environ.update(address.environment)
    robot = connect(address.robot)
    stack.enter_context(LeaseKeepAlive(robot.ensure_client(LeaseClient.default_service_name), must_acquire=True))
    robot.power_on(timeout_sec=30)
    blocking_stand(robot.ensure_client(RobotCommandClient.default_service_name), timeout_sec=30)
    return robot.ensure_client(RobotStateStreamingClient.default_service_name)


def slowest_hz(clients: list[RobotStateStreamingClient], seconds: float) -> float:
    """States a second of the slowest stream, all read at once."""
    rates: list[float] = []

    def read(client: RobotStateStreamingClient) -> None:
        stream = client.get_robot_state_stream()
        next(iter(stream))
        begin_s, count = time.monotonic(), 0
        for _ in stream:
            count += 1
            if time.monotonic() - begin_s > seconds:
                break
        rates.append(count / (time.monotonic() - begin_s))
        stream.cancel()

    readers = [threading.Thread(target=read, args=(client,)) for client in clients]
    for reader in readers:
        reader.start()
    for reader in readers:
        reader.join()
    return min(rates)


def fakes_held(seconds: float, most: int) -> dict[str, Any]:
    """How many fakes hold their rate, and the slowest's rate by number of fakes."""
    clients: list[RobotStateStreamingClient] = []
    told: dict[str, Any] = {"fakes_held": 0}
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        while len(clients) < most:
            clients += [standing(stack, folder) for _ in range(2)]
            told[f"slowest_of_{len(clients)}_hz"] = hz = round(slowest_hz(clients, seconds), 1)
            if hz < HELD * STATES_HZ:
                break
            told["fakes_held"] = len(clients)
    return told


def main() -> None:
    """Print one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=4.0, help="of each measurement")
    parser.add_argument("--most", type=int, default=12, help="fakes, an even number")
    chosen = parser.parse_args()
    print(json.dumps({"delay_ms": delays(chosen.seconds), **fakes_held(chosen.seconds, chosen.most)}))


if __name__ == "__main__":
    main()
