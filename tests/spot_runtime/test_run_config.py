"""Configurations: strict, complete, and explained."""

from __future__ import annotations

from pathlib import Path

import pytest

from spot_model.errors import BadInputError
from spot_runtime.config import RunConfig, load_config
from spot_runtime.session.labels import parse_labels
from spot_tools.options import resolve_config


def write(path: Path, text: str) -> Path:
    file = path / "run.yaml"
    file.write_text(text, encoding="utf-8")
    return file


def test_an_empty_file_means_the_defaults(tmp_path: Path) -> None:
    assert load_config(write(tmp_path, "")) == RunConfig()


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    config = load_config(write(tmp_path, "safety: {tilt_rad: 0.5}\nlog: {labels: {payload: none}}\n"))
    assert config.safety.tilt_rad == 0.5
    assert RunConfig.model_validate_json(config.to_json()) == config


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("safety: {tilt: 0.5}", ["safety.tilt", "unknown key"]),
        ("control: {end_time_ahead_s: 0.5}", ["control.end_time_ahead_s = 0.5", "less than or equal to 0.1"]),
        ("control: {end_time_ahead_s: .nan}", ["control.end_time_ahead_s"]),
        ("robot: {estop: maybe}", ["robot.estop = 'maybe'", "'auto', 'own' or 'external'"]),
        ("- 1", ["allowed: keys with values"]),
        ("a: [", ["is not valid YAML"]),
        ("!!python/object/apply:os.system [true]", ["is not valid YAML"]),
        ("schema: spot-rl/run/9", ["schema", "'spot-rl/run/1'"]),
    ],
)
def test_a_bad_file_is_refused_with_the_key_and_what_is_allowed(tmp_path: Path, text: str, words: list[str]) -> None:
    with pytest.raises(BadInputError) as caught:
        load_config(write(tmp_path, text))
    for word in words:
        assert word in str(caught.value)


def test_a_missing_and_a_huge_file_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="cannot be read: No such file"):
        load_config(tmp_path / "none.yaml")
    with pytest.raises(BadInputError, match="allowed: at most"):
        load_config(write(tmp_path, "#" * 1_100_000))


def test_no_field_of_the_configuration_can_hold_a_password() -> None:
    assert "password" not in RunConfig.model_json_schema()["$defs"]["RobotConfig"]["properties"]


def test_the_command_line_and_the_environment_come_before_the_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = write(tmp_path, "robot: {ca_file: from-file.pem}\nlog: {directory: from-file}\n")

    def resolved(ca_file: Path | None, log_dir: Path | None) -> tuple[str, str]:
        config = resolve_config(file, ca_file=ca_file, credentials_file=None, log_dir=log_dir)
        return str(config.robot.ca_file), str(config.log.directory)

    monkeypatch.delenv("SPOT_RL_CA_FILE", raising=False)
    assert resolved(None, None) == ("from-file.pem", "from-file")
    assert resolved(Path("c.pem"), Path("d")) == ("c.pem", "d")
    monkeypatch.setenv("SPOT_RL_CA_FILE", "e.pem")
    assert resolve_config(None, ca_file=None, credentials_file=None, log_dir=None).robot.ca_file == Path("e.pem")


def test_labels() -> None:
    assert parse_labels(["payload=none", "note=a=b", "empty="]) == {"payload": "none", "note": "a=b", "empty": ""}
    for texts in (["x"], ["=1"], ["a=1", "a=2"]):
        with pytest.raises(BadInputError, match="allowed: KEY=VALUE, each key once"):
            parse_labels(texts)
