"""Password and token of a run: in no log, incident file, summary, page, message, process list or child."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from proof.faulty import FaultyHal
from proof.rig import Rig, rig
from spot_log.page.page import write_page
from spot_log.page.summary import summarise
from spot_log.read.mcap_scan import scan_mcap
from spot_log.write.flight_recorder import flight_record_path
from spot_model.policy.contract import PolicyError
from spot_model.process.child_process import without_secrets
from spot_runtime.admission import check_allowed
from spot_tools.run import summary_text

WALK = Path(__file__).parents[3] / "policies" / "walk.onnx"


@pytest.fixture(scope="module")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Rig]:
    with rig(tmp_path_factory.mktemp("secrets"), WALK) as started:
        yield started


def processes() -> dict[str, bytes]:
    """Command line of every process, and the environment of those that we may read but for our own."""
    seen: dict[str, bytes] = {}
    for entry in Path("/proc").iterdir():
        if not entry.name.isdecimal():
            continue
        try:
            line = (entry / "cmdline").read_bytes()
            seen[f"{entry.name} command line"] = line
            if b"logger_child" in line:
                seen[f"{entry.name} environment"] = (entry / "environ").read_bytes()
        except OSError:
            continue
    return seen


def unpacked(path: Path) -> bytes:
    """A log's whole content, chunks unpacked."""
    scan = scan_mcap(path.read_bytes())
    parts = [message.data for message in scan.messages] + [attachment.data for attachment in scan.attachments]
    return b"".join([*parts, path.read_bytes()])


def test_a_canary_is_found_nowhere(fake: Rig, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    secrets: dict[str, bytes] = {"password": fake.address.environment["BOSDYN_CLIENT_PASSWORD"].encode()}
    seen: dict[str, bytes] = {}

    def act(hal: FaultyHal) -> None:
        robot: Any = hal._session._robot
        secrets["token"] = robot.user_token.encode()
        seen.update(processes())
        fake.inject("token_expired")
        fake.inject("nan_sensor", 0.5, signal="position")

    drive = fake.drive(act)
    fake.restore()
    assert drive.summary.outcome == "state_not_finite"
    assert all(len(secret) >= 8 for secret in secrets.values())
    assert drive.log is not None
    page = tmp_path / "page.html"
    write_page(drive.log, page)
    said = capfd.readouterr()
    seen |= {
        "log": unpacked(drive.log_path),
        "incident": unpacked(flight_record_path(drive.log_path)),
        "summary": (drive.summary.to_json() + summary_text(drive.summary) + summarise(drive.log)).encode(),
        "page": page.read_bytes(),
        "output": (said.out + said.err).encode(),
    }
    assert any("logger" in text.decode(errors="replace") for text in seen.values())
    for name, secret in secrets.items():
        assert [where for where, content in seen.items() if secret in content] == [], name


def test_a_wrong_password_is_not_quoted(fake: Rig, capfd: pytest.CaptureFixture[str]) -> None:
    real = fake.credentials_file.read_text(encoding="utf-8")
    fake.credentials_file.write_text("{username: user, password: canary-0815}", encoding="utf-8")
    try:
        drive = fake.drive()
    finally:
        fake.credentials_file.write_text(real, encoding="utf-8")
    assert drive.summary.outcome == "credentials_refused"
    said = capfd.readouterr()
    everything = said.out + said.err + drive.summary.to_json() + repr(unpacked(drive.log_path))
    assert "canary-0815" not in everything


def test_the_robots_keys_and_password_are_for_their_owner_alone(fake: Rig) -> None:
    state = fake.folder / "state"
    private = [path for path in state.rglob("*") if path.is_file() and ("key" in path.name or "pass" in path.name)]
    assert private
    assert [oct(path.stat().st_mode & 0o777) for path in private] == ["0o600"] * len(private)


def test_children_that_need_no_password_get_none() -> None:
    environment = {"BOSDYN_CLIENT_PASSWORD": "x", "A_TOKEN": "x", "CREDENTIALS_DIRECTORY": "x", "PATH": "/bin"}
    assert without_secrets(environment) == {"PATH": "/bin"}


def test_only_policies_on_the_list_run(fake: Rig, tmp_path: Path) -> None:
    policy = fake.policy
    check_allowed(Path("walk.onnx"), policy.sha256, ())
    check_allowed(Path("walk.onnx"), policy.sha256, ("0" * 64, policy.sha256))
    with pytest.raises(PolicyError, match=f"digest {policy.sha256}.*service.policy_sha256"):
        check_allowed(Path("walk.onnx"), policy.sha256, ("0" * 64,))
    from spot_tools.run import run

    config = tmp_path / "run.yaml"
    config.write_text(f"service: {{policy_sha256: ['{'0' * 64}']}}\n", encoding="utf-8")
    app = typer.Typer()
    app.command()(run)
    done = CliRunner().invoke(app, ["--robot", "h", "--policy", str(WALK), "--config", str(config)])
    assert isinstance(done.exception, PolicyError)
