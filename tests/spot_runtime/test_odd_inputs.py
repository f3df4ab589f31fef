"""Files and words that nobody means to give: each is refused in words that name it; none is taken for another."""

from __future__ import annotations

from pathlib import Path

import pytest

from spot_model.errors import BadInputError
from spot_model.yaml_text import YamlError, parse_yaml
from spot_runtime.cli import parse_labels
from spot_runtime.config import load_config
from spot_runtime.hal.address import parse_address
from spot_runtime.log import LogReadError, read_run

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
    "another encoding": ("safety: {}".encode("utf-16"), r"utf-8"),
    "two documents": (b"safety: {}\n---\nsafety: {}\n", r"single document"),
    "an object": (b"safety: !!python/object/apply:os.system ['true']\n", r"could not determine a constructor"),
    "a date": (b"safety: 2026-01-01\n", r"safety = '2026-01-01': Input should be an object"),
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


def test_a_log_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(LogReadError, match=r"there is no log .*none\.mcap; give"):
        read_run(tmp_path / "none.mcap")
