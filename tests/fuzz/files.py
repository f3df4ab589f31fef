"""Files that people write: YAML, CSV, NPZ."""

from __future__ import annotations

import io
import json
from functools import cache
from typing import Any

import numpy as np
from support import Target, folder, refusing, text_file

MODELS = ("spot_model",)
IMPORTING = ("spot_log.importing", "spot_model")


def scenario(data: bytes) -> None:
    """The fake robot's scenario."""
    from fake_robot.scenario.scenario import load_scenario

    text_file(data, load_scenario)


def scenario_seeds() -> list[bytes]:
    """Shipped ones that are short, and each part of the default one by itself."""
    from fake_robot.scenario.scenario import SHIPPED_FOLDER, Scenario

    shipped = [file.read_bytes() for file in sorted(SHIPPED_FOLDER.glob("*.yaml"))]
    short = [text for text in shipped if len(text) <= SCENARIO_BYTES]
    return (
        short
        + parts_of(Scenario().to_data())
        + [b"state_channel: {delay: {kind: empirical, edges_s: [0.0, 0.1], counts: [1]}}"]
    )


SCENARIO_BYTES = 300


def config(data: bytes) -> None:
    """The configuration of a run."""
    from spot_runtime.config import load_config

    text_file(data, lambda path: load_config(path).to_json())


def config_seeds() -> list[bytes]:
    from spot_runtime.config import RunConfig

    whole = json.loads(RunConfig().to_json())
    return [*parts_of(whole), b"safety: {tilt_rad: 0.5, state_age_damp_s: 0.03}", b"control: {end_time_ahead_s: .inf}"]


def parts_of(data: dict[str, Any]) -> list[bytes]:
    """Each key of a file alone, in flow style: short texts are fast ones."""
    import yaml

    texts = [yaml.safe_dump({key: value}, default_flow_style=True, width=10_000) for key, value in data.items()]
    return [text.encode() for text in texts if len(text) <= SCENARIO_BYTES]


def model_file(data: bytes) -> None:
    """The robot model with its effects."""
    from spot_model.io.model_file import load_model

    text_file(data, lambda path: load_model(str(path)).digest())


def model_file_seeds() -> list[bytes]:
    import yaml

    from spot_model.io.model_file import BUILT_IN

    effects = [effect for model in BUILT_IN.values() for effect in model.to_data()["effects"]]
    return [yaml.safe_dump({"effects": [effect]}, default_flow_style=True).encode() for effect in effects]


def yaml_text(data: bytes) -> None:
    """Whatever YAML it is: plain, bounded data, or a refusal."""
    from spot_model.io.yaml_text import MAX_VALUES, YamlError, parse_yaml

    try:
        value = parse_yaml(data)
    except YamlError:
        return
    if len(repr(value)) > 100 * MAX_VALUES:
        raise AssertionError("it grew beyond its bound")


def yaml_seeds() -> list[bytes]:
    return [
        b"a: &x [1, 2.5, .nan]\nb: *x\nc: {<<: {d: 2001-12-14t21:59:43.10-05:00}}\n",
        b"- !!binary aGVsbG8=\n- !!set {a, b}\n- !!omap [a: 1]\n- 0x1F\n- 190:20:30\n- ~\n",
        b"--- |\n text\n more\n...\n",
        b'"\\u263a \\x41": >-\n  folded\n',
        b"\xef\xbb\xbfa: 1\r\nb: 2\r\n",
    ]


def mapping(data: bytes) -> None:
    """The mapping of a foreign recording."""
    from spot_log.importing import load_mapping

    text_file(data, load_mapping)


def mapping_seeds() -> list[bytes]:
    return [
        b"schema: spot-rl/import/1\ntime: {rate_hz: 100}\nsignals: {position: {from: q}}\n",
        (
            b"schema: spot-rl/import/1\ntime: {from: t, unit: s}\nsignals: {position: {from: q, unit: rad}, velocity: "
            b"{columns: [a, b], unit: rad/s}}\njoint_names: [a, b]\nsource_joint_names: [b, a]\n"
        ),
    ]


@cache
def _mappings() -> tuple[Any, ...]:
    from spot_log.importing.mapping import Mapping

    schema, joints = "spot-rl/import/1", ["a", "b"]
    position = {"from": "q", "unit": "rad"}
    quaternion = {"from": "w", "order": "xyzw"}
    named = {"from": "{joint}", "unit": "deg"}
    return (
        Mapping.model_validate(
            {
                "schema": schema,
                "time": {"from": "t", "unit": "s"},
                "signals": {"position": position},
                "joint_names": joints,
            }
        ),
        Mapping.model_validate(
            {
                "schema": schema,
                "time": {"rate_hz": 100.0},
                "signals": {"position": position, "odom_from_body": quaternion},
                "joint_names": joints,
            }
        ),
        Mapping.model_validate(
            {
                "schema": schema,
                "time": {"from": "t", "unit": "ns", "clock": "unix"},
                "signals": {"position": named},
                "joint_names": joints,
            }
        ),
    )


def recording(data: bytes) -> None:
    """A foreign recording, by its first byte as CSV or NPZ through one of some mappings, up to a log's records."""
    from spot_log.importing.checks import doubts_of
    from spot_log.importing.importer import records_of
    from spot_log.importing.recording import ForeignRecording

    first = (data[:1] or b"\0")[0]
    source = folder() / ("input.csv" if first < 0x40 else "input.npz")
    source.write_bytes(data[1:])
    with refusing(OSError):
        taken = ForeignRecording(source, _mappings()[first % 3])
        doubts_of(taken)
        for record in records_of(taken):
            record.SerializeToString()


def recording_seeds() -> list[bytes]:
    rows = np.linspace(0.0, 0.02, 3)
    lines = "".join(f"{t:.2f},0.1,0.2\n" for t in rows)
    seeds = [b"\x00t,q_0,q_1\n" + lines.encode(), b"\x02t,a,b\n1,0.1,0.2\n2,0.1,0.2\n"]
    for first, arrays in (
        (b"\xff", {"t": rows, "q": np.zeros((3, 2))}),
        (b"\xfe", {"q": np.zeros((2, 2)), "w": np.tile([0.0, 0.0, 0.0, 1.0], (2, 1))}),
    ):
        packed = io.BytesIO()
        np.savez(packed, **arrays)  # type: ignore[arg-type, unused-ignore]
        seeds.append(first + packed.getvalue())
        packed = io.BytesIO()
        np.savez_compressed(packed, **arrays)  # type: ignore[arg-type, unused-ignore]
        seeds.append(first + packed.getvalue())
    return seeds


def sequence(data: bytes) -> None:
    """A sequence of velocity commands."""
    from spot_model.io.velocity_sequence import load_sequence

    text_file(data, lambda path: load_sequence(str(path)).at(1.0))


def sequence_seeds() -> list[bytes]:
    return [
        b"name: a\nduration_s: 2.0\nwaypoints:\n- {time_s: 0.0, v_x_m_s: 1.0}\n- {time_s: 1.0, yaw_rate_rad_s: 0.5}\n"
    ]


def credentials(data: bytes) -> None:
    """User name and password; an error must not quote them."""
    from spot_runtime.hal.credentials import find_credentials
    from spot_runtime.hal.errors import CredentialsError

    path = folder() / "credentials.yaml"
    if not path.exists():
        path.touch(mode=0o600)
    path.write_bytes(data)
    try:
        find_credentials(path, {})
    except CredentialsError as error:
        if b"canary" in data and "canary" in str(error):
            raise AssertionError("the error quotes the file") from error


def credentials_seeds() -> list[bytes]:
    return [b"username: user\npassword: canary\n", b"username: [canary]\n", b"password: canary: canary\n"]


YAML_WORDS = (b"&a ", b"*a", b"<<: ", b"!!", b"- ", b": ", b".nan", b".inf", b"-.inf", b"null", b"1e999", b"{}", b"[]")
PURE_PYTHON = "PyYAML in Python: some 200 µs for 200 bytes"

FILES = {
    "yaml": Target(yaml_text, yaml_seeds, ("yaml", "spot_model.io.yaml_text"), 256, YAML_WORDS, PURE_PYTHON),
    "scenario": Target(scenario, scenario_seeds, ("fake_robot", "spot_model"), 300, YAML_WORDS, PURE_PYTHON),
    "config": Target(config, config_seeds, ("spot_runtime", "spot_model"), 300, YAML_WORDS, PURE_PYTHON),
    "model_file": Target(model_file, model_file_seeds, MODELS, 300, YAML_WORDS, PURE_PYTHON),
    "mapping": Target(mapping, mapping_seeds, IMPORTING, 300, YAML_WORDS, PURE_PYTHON),
    "sequence": Target(sequence, sequence_seeds, MODELS, 256, YAML_WORDS, PURE_PYTHON),
    "credentials": Target(credentials, credentials_seeds, max_len=128, words=YAML_WORDS),
    "recording": Target(recording, recording_seeds, IMPORTING, 1200, (), "NumPy's reader of NPZ, some 200 µs a file"),
}
