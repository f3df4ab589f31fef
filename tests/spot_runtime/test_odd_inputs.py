"""Files and words that nobody means to give: each is refused in words that name it; none is taken for another."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from spot_log import LogReadError, read_run
from spot_log.importing import import_log, load_mapping
from spot_model.errors import BadInputError
from spot_model.io.yaml_text import YamlError, parse_yaml
from spot_runtime.config import load_config
from spot_runtime.hal.address import parse_address
from spot_runtime.hal.credentials import PASSWORD_VARIABLE, USERNAME_VARIABLE, find_credentials
from spot_runtime.hal.errors import CredentialsError
from spot_runtime.operator.listening import is_loopback
from spot_runtime.session.labels import parse_labels
from spot_tools.options import resolve_config

CONFIGS = {
    "a key twice": (b"safety: {tilt_rad: 0.5}\nsafety: {tilt_rad: 1.4}\n", r"line 2: the key 'safety' comes twice"),
    "a bound twice": (b"safety: {tilt_rad: 0.5, 'tilt_rad': 1.4}\n", r"the key 'tilt_rad' comes twice"),
    "true for a number": (b"safety: {tilt_rad: true}\n", r"safety\.tilt_rad = True: Input should be a valid number"),
    "a text for a number": (
        b"safety: {tilt_rad: '0.5'}\n",
        r"safety\.tilt_rad = '0\.5': Input should be a valid number",
    ),
    "degrees": (b"safety: {tilt_rad: 45}\n", r"safety\.tilt_rad = 45: .*less than or equal to 3\.2"),
    "milliseconds": (b"control: {end_time_ahead_s: 50}\n", r"end_time_ahead_s = 50: .*less than or equal to 0\.1"),
    "no number": (b"safety: {tilt_rad: .nan}\n", r"finite number"),
    "beyond all numbers": (b"safety: {tilt_rad: 1e400}\n", r"tilt_rad = inf: .*finite number"),
    "a sign": (b"safety: {tilt_rad: -0.5}\n", r"greater than 0"),
    "zero": (b"safety: {tilt_rad: 0}\n", r"greater than 0"),
    "ages in the wrong order": (b"safety: {state_age_damp_s: 0.3}\n", r"must rise: state_age_warn_s"),
    "a CPU below none": (b"real_time: {cpu_affinity: [-1]}\n", r"cpu_affinity\.0 = -1"),
    "NUL in a path": (b'log: {directory: "a\\0b"}\n', r"line 1 holds a NUL character"),
    "another encoding": ("safety: {}".encode("utf-16"), r"byte 0 is no UTF-8 text"),
    "two documents": (b"safety: {}\n---\nsafety: {}\n", r"single document"),
    "an object": (b"safety: !!python/object/apply:os.system ['true']\n", r"could not determine a constructor"),
    "a date": (b"safety: 2026-01-01\n", r"safety = '2026-01-01': allowed: keys with values"),
}


@pytest.mark.parametrize("name", CONFIGS)
def test_configurations_that_are_refused(name: str, tmp_path: Path) -> None:
    content, words = CONFIGS[name]
    path = tmp_path / "run.yaml"
    path.write_bytes(content)
    with pytest.raises(BadInputError, match=words):
        load_config(path)


@pytest.mark.parametrize(
    "content", [b"", b"\xef\xbb\xbfsafety: {tilt_rad: 0.5}\n", b"safety:\r\n  tilt_rad: 5.0e-1\r\n"]
)
def test_configurations_that_are_taken(content: bytes, tmp_path: Path) -> None:
    path = tmp_path / "run.yaml"
    path.write_bytes(content)
    assert load_config(path).safety.tilt_rad == (0.5 if content else 0.785398)


NO_UTF_8 = "a\udcff"
"""What Python makes of the bytes 61 ff in an argument or the environment."""


@pytest.mark.parametrize("name", ["ca_file", "credentials_file", "log_dir"])
def test_paths_that_no_log_can_hold(name: str) -> None:
    paths: dict[str, Path | None] = {"ca_file": None, "credentials_file": None, "log_dir": None, name: Path(NO_UTF_8)}
    with pytest.raises(BadInputError, match=r"path 'a\\udcff' is no UTF-8; rename it"):
        resolve_config(None, **paths)


def test_a_password_that_is_no_text_does_not_show() -> None:
    with pytest.raises(CredentialsError, match="BOSDYN_CLIENT_PASSWORD is no UTF-8") as refused:
        find_credentials(None, {USERNAME_VARIABLE: "user", PASSWORD_VARIABLE: NO_UTF_8})
    assert NO_UTF_8 not in str(refused.value)
    assert refused.value.__cause__ is None


def test_numbers_as_everybody_writes_them() -> None:
    assert parse_yaml("[1e-3, 1E5, -2.5e+3, .5e1, 12e03]") == [0.001, 1e5, -2500.0, 5.0, 12000.0]
    assert parse_yaml("[e5, 1e, 1e5x, '1e-3', -, .]") == ["e5", "1e", "1e5x", "1e-3", "-", "."]


def test_merged_keys_are_no_repeated_ones() -> None:
    assert parse_yaml("a: &a {x: 1, y: 2}\nb: {<<: *a, x: 3}")["b"] == {"x": 3, "y": 2}
    assert parse_yaml("{1: a, '1': b}") == {1: "a", "1": "b"}
    with pytest.raises(YamlError, match="comes twice"):
        parse_yaml("{1: a, 1: b}")


@pytest.mark.parametrize("text", [".", "..", "a..b", "x" * 5000, "::::", "user@host", "user@host:443", "http://host"])
def test_addresses_that_no_robot_has(text: str) -> None:
    with pytest.raises(BadInputError, match="is not valid; allowed: HOST"):
        parse_address(text)


def test_addresses_that_robots_have() -> None:
    for text in ("spot-1.local", "a_b:8443", "192.168.80.3", "::1", "[fe80::1%eth0]:8443", "spot."):
        parse_address(text)


@pytest.mark.parametrize("text", ["a" * 65 + "=b", "a=" + "b" * 257, "a=\x1b[2J", "a b=c", "ä=b"])
def test_labels_that_no_log_can_show(text: str) -> None:
    with pytest.raises(BadInputError, match="at most 256"):
        parse_labels([text])


@pytest.mark.parametrize(
    "address", ["localhost:99999", "localhost:65536", "localhost:1" + "0" * 30, "hello", ":1", "unix:/\udcff"]
)
def test_ports_that_nobody_can_listen_on(address: str) -> None:
    with pytest.raises(BadInputError, match=r"is not valid; allowed: .*65535"):
        is_loopback(address)


MAPPING = """schema: spot-rl/import/1
time: {from: t, unit: s}
signals: {position: {from: q, unit: rad}}
joint_names: [a, b]
"""
TIMES = {
    "no rows": np.zeros(0),
    "beyond all stamps": np.array([0.0, 1.0, 1e300]),
    "whole numbers beyond all stamps": np.array([2**63, 2**63 + 1, 2**63 + 2], dtype=np.uint64),
    "truth values": np.array([False, True]),
    "infinite": np.array([0.0, np.inf]),
}


@pytest.mark.parametrize("name", TIMES)
def test_times_that_no_log_can_hold(name: str, tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(MAPPING, encoding="utf-8")
    np.savez(tmp_path / "r.npz", t=TIMES[name], q=np.zeros((len(TIMES[name]), 2)))
    with pytest.raises(BadInputError, match="time: "):
        import_log(load_mapping(tmp_path / "m.yaml"), tmp_path / "r.npz", tmp_path / "o.mcap")
    assert not list(tmp_path.glob("o.mcap*"))


def test_recordings_that_are_no_files_or_name_a_column_twice(tmp_path: Path) -> None:
    (tmp_path / "m.yaml").write_text(MAPPING, encoding="utf-8")
    mapping = load_mapping(tmp_path / "m.yaml")
    (tmp_path / "endless.csv").symlink_to("/dev/zero")
    with pytest.raises(BadInputError, match="is no file"):
        import_log(mapping, tmp_path / "endless.csv", tmp_path / "o.mcap")
    (tmp_path / "r.csv").write_text("t,t,q_0\n0,1,2\n", encoding="utf-8")
    with pytest.raises(BadInputError, match="'t' comes twice"):
        import_log(mapping, tmp_path / "r.csv", tmp_path / "o.mcap")


def test_a_log_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(LogReadError, match=r"there is no log .*none\.mcap; give"):
        read_run(tmp_path / "none.mcap")
