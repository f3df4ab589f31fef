"""Commands of the pages that need a service of their own, with certificates or a live view; benchmarks, made short."""

from __future__ import annotations

import json
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from tests.spot_runtime.live.viewer import Viewer

from .blocks import REPOSITORY
from .shell import ENVIRONMENT, bash, block_with, said_until

pytestmark = pytest.mark.slow


@pytest.fixture
def certificates(tmp_path: Path) -> Path:
    """A folder with what the page's commands make, for this computer in the place of the robot's."""
    folder = tmp_path / "a folder"
    folder.mkdir()
    bash(block_with("operate", "openssl req").text.replace("192.168.50.5", "127.0.0.1"), folder)
    return folder


def test_operating_over_a_network(certificates: Path) -> None:
    config = block_with("operate", "tls_client_ca").text.replace("/etc/spot-rl", str(certificates))
    (certificates / "run.yaml").write_text(config.replace("0.0.0.0:8700", "127.0.0.1:0"))
    words = ["spot-rl", "serve", "--robot", "192.168.50.3", "--config", "run.yaml"]
    environment = {**ENVIRONMENT, "HOME": str(certificates)}
    with said_until("operators reach this service at", words, certificates, environment) as said:
        line = block_with("operate", "spot-rl ctl --address").text
        told = bash(line.replace("192.168.50.5:8700", said[-1].split()[-1]), certificates)
    assert "idle" in told


def test_live_view(certificates: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    words = block_with("live", "--live-port").text.replace("8765", port).split()
    environment = {**ENVIRONMENT, "HOME": str(certificates), "XDG_RUNTIME_DIR": str(certificates)}
    with said_until("operators reach this service at", words, certificates, environment):
        viewer = Viewer(f"ws://localhost:{port}")
        topics = {channel["topic"] for channel in viewer.channels.values()}
        viewer.close()
    table = (REPOSITORY / "docs" / "live.md").read_text(encoding="utf-8")
    assert topics == set(re.findall(r"`(/[a-z_]+)`", table))


def test_what_the_fake_robot_prints_is_what_the_next_terminal_needs(tmp_path: Path) -> None:
    words = block_with("first-run-fake", "fake-robot --port 8443").text.split()
    environment = {**ENVIRONMENT, "XDG_STATE_HOME": str(tmp_path)}
    command = ["0" if word == "8443" else word for word in words]  # any port that is free
    with said_until("your_program.py", command, tmp_path, environment) as said:
        exports = [line.strip() for line in said if "export " in line and "PYTHONPATH" not in line]
        assert len(exports) == 3
        robot = next(line for line in said if "host argument" in line).split(":", 1)[1].split(",")[0]
        doctor = block_with("first-run-fake", "spot-rl doctor").lines[0].replace("127.0.0.1:8443", robot)
        told = bash("\n".join([*exports, doctor]), tmp_path)
    assert f"{robot} account: logged in" in told


def test_benchmarks_at_their_smallest(tmp_path: Path) -> None:
    (tmp_path / "lab").symlink_to(REPOSITORY / "lab")
    told = bash("spot-rl bench faults --json --only 'policy file cut in half'", tmp_path)
    assert json.loads(told)["failed"] == 0
    bash("spot-rl bench soak --minutes 0.05", tmp_path)
    assert json.loads(bash("python lab/benchmarks/loop_lock_step.py 1", tmp_path))["times_real_time"] > 0.0
    told = bash("python lab/benchmarks/inference_pace.py --seconds 5 --seconds 0.1", tmp_path)
    assert set(json.loads(told)) == {"provider", "hot", "at_50_hz"}


def test_another_provider_is_refused_where_it_is_not(tmp_path: Path) -> None:
    told = subprocess.run(
        [sys.executable, "lab/benchmarks/inference_pace.py", "--provider", "CUDAExecutionProvider", "--seconds", "0.1"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
    )
    assert told.returncode == 0 or "CUDAExecutionProvider is not here" in told.stderr
