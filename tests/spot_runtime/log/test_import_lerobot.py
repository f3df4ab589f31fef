"""LeRobot data sets in both layouts, as their documentation has them, become logs: one episode, or each."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet
from typer.testing import CliRunner

from spot_log import read_run
from spot_log.commands import app
from spot_log.importing import import_log, load_mapping
from spot_log.importing.suggest import suggest
from spot_model.errors import BadInputError

N, FPS = 60, 30
MOTORS = ["pan.pos", "lift.pos"]
LAYOUTS = {
    "v2.1": ([[*MOTORS]], "data/chunk-{episode_chunk:03d}/episode_{episode_index:06d}.parquet"),
    "v3.0": ({"motors": MOTORS}, "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"),
}


def swing(episode: int) -> np.ndarray:
    """Degrees, (N, 2)."""
    return 20.0 * np.sin(np.arange(N)[:, None] * 0.1 * np.array([1.0, 1.3]) + episode)


@pytest.fixture(params=LAYOUTS)
def data_set(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """Two episodes, with a picture beside the numbers."""
    names, path = LAYOUTS[request.param]
    motors = {"dtype": "float32", "shape": [2], "names": names}
    one = {"shape": [1], "names": None}
    features: dict[str, Any] = {"observation.state": motors, "action": motors, "timestamp": {"dtype": "float32", **one}}
    features |= {name: {"dtype": "int64", **one} for name in ("frame_index", "episode_index")}
    features["observation.images.top"] = {"dtype": "image", "shape": [4, 4, 3], "names": None}
    info = {"codebase_version": request.param, "fps": FPS, "total_episodes": 2, "data_path": path, "features": features}
    root = tmp_path / "arm"
    (root / "meta").mkdir(parents=True)
    (root / "meta" / "info.json").write_text(json.dumps(info))
    tables = []
    for episode in range(2):
        motor_rows = pa.array(swing(episode).tolist(), pa.list_(pa.float32(), 2))
        columns = dict.fromkeys(("observation.state", "action"), motor_rows)
        columns |= {"timestamp": pa.array(np.arange(N) / FPS, pa.float32()), "frame_index": np.arange(N)}
        columns |= {"episode_index": np.full(N, episode), "observation.images.top": [b"png"] * N}
        tables.append(pa.table(columns))
    parts = tables if request.param == "v2.1" else [pa.concat_tables(tables)]
    for i, table in enumerate(parts):
        file = root / path.format(episode_chunk=0, episode_index=i, chunk_index=0, file_index=i)
        file.parent.mkdir(parents=True, exist_ok=True)
        parquet.write_table(table, file)
    return root


def test_episodes_become_logs_by_the_suggested_mapping(data_set: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(suggest(data_set))
    assert load_mapping(mapping).joint_names == ("pan", "lift")
    words = ["import", str(mapping), str(data_set), "--out", str(tmp_path / "logs"), "--episode", "all"]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    for episode in range(2):
        run = read_run(tmp_path / "logs" / f"episode_{episode:06d}.mcap")
        assert run.header.repeat == episode
        assert run.states.position_rad == pytest.approx(np.radians(swing(episode)), abs=1e-6)
        assert run.commands.position_rad == pytest.approx(np.radians(swing(episode)), abs=1e-6)
        assert np.diff(run.states.robot_stamp_ns) == pytest.approx(1e9 / FPS, rel=1e-4)


def test_errors_name_the_episode_and_what_there_is(data_set: Path, tmp_path: Path) -> None:
    mapping = tmp_path / "mapping.yaml"
    mapping.write_text(suggest(data_set))
    with pytest.raises(BadInputError, match="holds 2 episodes, 0 to 1; give --episode NUMBER"):
        import_log(load_mapping(mapping), data_set, tmp_path / "x.mcap")
    words = ["import", str(mapping), str(data_set), "--out", str(tmp_path / "x.mcap"), "--episode", "7"]
    assert "--episode '7': " in str(CliRunner().invoke(app, words).exception)
    other = ["import", str(mapping), str(tmp_path), *words[3:]]
    assert "is no LeRobot data set" in str(CliRunner().invoke(app, other).exception)
    with pytest.raises(BadInputError, match=r"has no data of episode 5; by meta/info\.json it holds 0 to 1"):
        import_log(load_mapping(mapping).model_copy(update={"episode": 5}), data_set, tmp_path / "x.mcap")
    info = data_set / "meta" / "info.json"
    info.write_text(info.read_text().replace("v2.1", "v1.6").replace("v3.0", "v1.6"))
    with pytest.raises(BadInputError, match=r"versions 2 and 3 can be read, and this is not so:\s+codebase_version"):
        import_log(load_mapping(mapping), data_set, tmp_path / "x.mcap")
    assert not (tmp_path / "x.mcap").exists()
