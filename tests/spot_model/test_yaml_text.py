"""YAML from outside: plain data comes through, and what could hang, crash or run code is refused in words."""

from __future__ import annotations

from pathlib import Path

import pytest

from spot_model.errors import BadInputError
from spot_model.io.yaml_text import MAX_BYTES, YamlError, parse_yaml, read_yaml

LAUGHS = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 9)
)


@pytest.mark.parametrize(
    ("text", "data"),
    [
        ("", None),
        ("a: 1\nb: [1.5, true, null, x]", {"a": 1, "b": [1.5, True, None, "x"]}),
        (b"a: \xc3\xa9", {"a": "é"}),
        ("base: &b {x: 1}\nother: *b", {"base": {"x": 1}, "other": {"x": 1}}),
        ("[" * 49 + "]" * 49, None),
        ("a: ['010', \"1:30\", 0x10, 1_000, 0, -0, 12:30 h]", {"a": ["010", "1:30", 16, 1000, 0, 0, "12:30 h"]}),
    ],
)
def test_plain_data(text: str | bytes, data: object) -> None:
    parsed = parse_yaml(text)
    assert parsed == data if data is not None else True


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: [", "expected"),
        ("!!python/object/apply:os.system [true]", "could not determine a constructor"),
        (LAUGHS, "more than 200000 values once its aliases are written out"),
        ("a: &a [*a]", "more than 200000 values"),
        ("[" * 60 + "]" * 60, "nested more than 50 deep"),
        ("{" * 5000, "nested more than 50 deep"),
        ("x" * (MAX_BYTES + 1), "allowed: at most 1048576"),
        ("a: 2020-99-99", "month must be in"),
        ("? [a]\n: b", "unhashable"),
        (b"a: \xff\xfe", "byte 3 is no UTF-8 text"),
        ("a: \x07", "special characters"),
        ("--- 1\n--- 2", "single document"),
        ("a: 0x" + "f" * 40, "line 1: a whole number has more than 128 bits"),
        ("a: 0x" + "f" * 4000, "more than 128 bits"),
        ("a: " + "9" * 5000, "4300 digits"),
        ("a: 1\nb: 1:30", "line 2: 1:30 is a number to some and none to others"),
        ("a: 1:30.5", "1:30.5 is a number to some"),
        ("a: 010", "010 is a number to some"),
    ],
)
def test_refusals(text: str | bytes, words: str) -> None:
    with pytest.raises(YamlError, match=words) as raised:
        parse_yaml(text)
    assert "\n" not in str(raised.value)


def test_files(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("a: 1", encoding="utf-8")
    assert read_yaml(path, "thing") == {"a": 1}
    with pytest.raises(BadInputError, match=r"thing .*none\.yaml cannot be read: No such file"):
        read_yaml(tmp_path / "none.yaml", "thing")
    with pytest.raises(BadInputError, match="cannot be read: Is a directory"):
        read_yaml(tmp_path, "thing")
    with pytest.raises(BadInputError, match="allowed: at most 1048576"):
        read_yaml(Path("/dev/zero"), "thing")
    with pytest.raises(BadInputError, match="cannot be read: embedded null byte"):
        read_yaml(Path("a\x00b"), "thing")
