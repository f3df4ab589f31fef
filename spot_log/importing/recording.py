"""Read one signal from a recording: find it, select columns, convert units, reorder joints."""

from __future__ import annotations

import csv
import math
import zipfile
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from spot_log.importing.bag import is_bag, read_rows
from spot_log.importing.lerobot import is_lerobot, read_episode
from spot_log.importing.mapping import JOINTS, SIGNALS, Mapping, SignalMapping, TimeMapping
from spot_log.importing.reading import reading
from spot_model.errors import BadInputError
from spot_model.robot.facts import Array

Arrays = dict[str, NDArray[Any]]

MAX_UNPACKED_BYTES: Final = 8 << 30


def read_arrays(path: Path) -> Arrays:
    """Read every array or column of a file, by name.

    Raises:
        BadInputError: The format is unknown, the file is not of it, or the package that reads it is missing.
        OSError: The file cannot be read.
    """
    if path.suffix.lower() not in _READERS:
        known = ", ".join((*_READERS, "LeRobot data sets (a folder)", "ROS 2 bags (a folder, .mcap, .db3)"))
        raise BadInputError(f"{path}: {path.suffix or 'no suffix'!r} is no known format; allowed: {known}")
    if not path.is_file():
        raise BadInputError(f"{path} {'is no file' if path.exists() else 'does not exist'}; give a recording")
    kind, package, reader = _READERS[path.suffix.lower()]
    with reading(path, kind, package):
        return reader(path)


def _read_npz(path: Path) -> Arrays:
    # Opened here, because NumPy leaves a file open that is not an archive.
    with path.open("rb") as file:
        _check_size(file)
        # Object arrays would be unpickled, and a pickle can run code.
        with np.load(file, allow_pickle=False) as data:
            arrays = {name: data[name] for name in data.files}
    # NumPy returns a member that is not an array as bytes.
    strange = [name for name, array in arrays.items() if not isinstance(array, np.ndarray)]
    if strange:
        raise BadInputError(f"{path}: member {strange[0]!r} is no array; write it with numpy.savez")
    return arrays


def _check_size(file: BinaryIO) -> None:
    """Refuse an archive that claims to unpack to more than any recording. Raises ValueError, BadZipFile."""
    with zipfile.ZipFile(file) as archive:
        size = sum(member.file_size for member in archive.infolist())
    if size > MAX_UNPACKED_BYTES:
        raise ValueError(f"it unpacks to {size} bytes; allowed: {MAX_UNPACKED_BYTES}")
    file.seek(0)


def _read_csv(path: Path) -> Arrays:
    with path.open(newline="", encoding="utf-8-sig") as file:
        head = file.readline()
        file.seek(0)
        delimiter = max(",;\t", key=head.count)
        rows = list(csv.reader(file, delimiter=delimiter))
    while rows and not rows[-1]:
        rows.pop()
    if len(rows) < 2:
        raise BadInputError(f"{path} has no rows; its first line must name the columns")
    names = [name.strip() for name in rows[0]]
    repeated = sorted(name for name, count in Counter(names).items() if count > 1)
    if repeated:
        raise BadInputError(f"{path}: the column {repeated[0]!r} comes twice in the first line; rename one")
    for number, row in enumerate(rows[1:], start=2):
        if len(row) != len(names):
            raise BadInputError(f"{path}: line {number} has {len(row)} values, the first line names {len(names)}")
    columns = zip(*rows[1:], strict=True)
    return {name: _numbers(column, delimiter) for name, column in zip(names, columns, strict=True)}


def _numbers(column: tuple[str, ...], delimiter: str) -> NDArray[Any]:
    """A column; between semicolons or tabs a comma is a decimal one, between commas it could divide thousands."""
    numbers = [_number(text if delimiter == "," else text.replace(",", ".")) for text in column]
    return np.array(column, dtype=np.str_) if None in numbers else np.array(numbers, dtype=np.float64)


def _number(text: Any) -> float | None:
    """A cell; NaN where it is blank, None where it is no number."""
    try:
        return float(text) if str(text).strip() else math.nan
    except (ValueError, TypeError):
        return None


def _read_parquet(path: Path) -> Arrays:
    from pyarrow import parquet

    table = parquet.read_table(path)
    return {name: np.asarray(table.column(name).to_pylist()) for name in table.column_names}


def _read_hdf5(path: Path) -> Arrays:
    import h5py  # type: ignore[import-not-found, import-untyped, unused-ignore]

    arrays: Arrays = {}

    def take(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            arrays[name] = np.asarray(node)

    with h5py.File(path, "r") as file:
        file.visititems(take)
    return arrays


_READERS: Final[dict[str, tuple[str, str, Callable[[Path], Arrays]]]] = {
    ".npz": ("NPZ", "numpy", _read_npz),
    ".csv": ("CSV", "numpy", _read_csv),
    ".parquet": ("Parquet", "'spot-rl[report]'", _read_parquet),
    ".h5": ("HDF5", "h5py", _read_hdf5),
    ".hdf5": ("HDF5", "h5py", _read_hdf5),
}
"""Name of the format, what installs its reader, and the reader, by suffix."""


UNITS: Final[dict[str, dict[str, float]]] = {
    "angle": {"rad": 1.0, "deg": math.pi / 180, "turn": 2 * math.pi},
    "angular velocity": {"rad/s": 1.0, "deg/s": math.pi / 180, "rpm": 2 * math.pi / 60},
    "torque": {"N·m": 1.0, "Nm": 1.0, "mN·m": 1e-3, "mNm": 1e-3},
    "length": {"m": 1.0, "mm": 1e-3, "cm": 1e-2},
    "velocity": {"m/s": 1.0, "mm/s": 1e-3},
    "acceleration": {"m/s^2": 1.0, "m/s²": 1.0, "g": 9.80665},
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9},
    "stiffness": {"N·m/rad": 1.0, "Nm/rad": 1.0},
    "damping": {"N·m·s/rad": 1.0, "Nms/rad": 1.0},
    "voltage": {"V": 1.0, "mV": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
    "temperature": {"°C": 1.0, "C": 1.0},
    "share": {"%": 1.0, "1": 100.0},
    "none": {"1": 1.0},
}
"""Kind of quantity, then unit, then the factor that turns a value into rad, rad/s, N·m, m, m/s, s, V, A, °C or %."""


def factor_of(unit: str | None, kind: str, where: str) -> float:
    """Return the factor from ``unit`` to ours.

    Raises:
        BadInputError: The unit is missing where one is needed, or is not one of that kind of quantity.
    """
    allowed = UNITS[kind]
    if unit is None and kind == "none":
        return 1.0
    if unit not in allowed:
        given = "has no unit" if unit is None else f"unit {unit!r} is not one of {kind}"
        raise BadInputError(f"{where}: {given}; allowed: {', '.join(allowed)}")
    return allowed[unit]


RELATIVE_ORIGIN_NS = 1_000_000_000
"""Stamp of the first row of a recording without a clock: zero would mean "unknown" in a log."""

LONGEST_S = 9e9
"""285 years: what 63 bits of nanoseconds hold."""


class ForeignRecording:
    """A recording and its mapping; other files are read when a signal asks for them."""

    def __init__(self, path: Path, mapping: Mapping) -> None:
        self.path = path
        self.mapping = mapping
        self._files: dict[Path, Arrays] = {}
        self._signals: dict[str, Array] = {}
        self.stamps_ns = self._stamps()

    def has(self, name: str) -> bool:
        """Whether the mapping names this signal."""
        return name in self.mapping.signals

    def rows_with(self, *names: str) -> NDArray[np.bool_]:
        """Rows in which one of these signals has a value of its own: a table of several topics is blank between."""
        signals = self.mapping.signals
        measured = [name for name in names if name in signals and signals[name].value is None]
        some = [np.isfinite(self.signal(name)).any(axis=1) for name in measured]
        return np.logical_or.reduce(some) if some else np.ones(len(self.stamps_ns), dtype=np.bool_)

    def signal(self, name: str) -> Array:
        """One signal in our unit and order.

        Returns:
            Shape (n, width); per-joint signals in the log's joint order, quaternions scalar first.

        Raises:
            BadInputError: It is not there, or has another shape or unit than it must.
        """
        if name not in self._signals:
            self._signals[name] = self._signal(name)
        return self._signals[name]

    def _signal(self, name: str) -> Array:
        spec = self.mapping.signals[name]
        where = f"signal {name}"
        signal, per_joint = SIGNALS[name], SIGNALS[name].width == JOINTS
        width = len(self.mapping.source_joints) if per_joint else signal.width
        factor = factor_of(spec.unit, signal.quantity, where)
        raw = self._constant(spec, width) if spec.source is None else self._columns(spec, where)
        if width and raw.shape[1] != width:
            raise BadInputError(f"{where} has {raw.shape[1]} columns; expected {width}")
        if len(raw) != len(self.stamps_ns):
            raise BadInputError(f"{where} has {len(raw)} rows, the time has {len(self.stamps_ns)}")
        values = raw * factor * _row(spec.scale, raw.shape[1], f"{where}: scale")
        values = values + _row(spec.offset, raw.shape[1], f"{where}: offset")
        if per_joint:
            source = self.mapping.source_joints
            values = values[:, [source.index(joint) for joint in self.mapping.joint_names]]
        if name == "odom_from_body":
            values = _scalar_first(values, spec)
        return np.ascontiguousarray(values)

    def _constant(self, spec: SignalMapping, width: int) -> Array:
        value = np.atleast_1d(np.asarray(spec.value, dtype=np.float64))
        value = np.repeat(value, width) if len(value) == 1 and width > 1 else value
        return np.tile(value, (len(self.stamps_ns), 1))

    def _columns(self, spec: SignalMapping, where: str) -> Array:
        assert spec.source is not None  # noqa: S101
        arrays = self._arrays(spec.file)
        if isinstance(spec.source, str) and "{" not in spec.source:
            array = self._find(arrays, spec.source, where, spec.file)
            return _two_axes(array, spec, where)
        patterns = (spec.source,) if isinstance(spec.source, str) else spec.source
        names = [name for pattern in patterns for name in self._expand(pattern)]
        return np.column_stack([self._find(arrays, name, where, spec.file) for name in names]).astype(np.float64)

    def _expand(self, pattern: str) -> list[str]:
        for word, names in (("{joint}", self.mapping.source_joints), ("{foot}", self.mapping.foot_names)):
            if word in pattern:
                return [pattern.replace(word, self.mapping.names_in_source.get(name, name)) for name in names]
        return [pattern]

    def _find(self, arrays: Arrays, name: str, where: str, file: str | None) -> NDArray[Any]:
        if name not in arrays:
            topic = name.partition(".")[0]
            found = ", ".join(sorted(arrays, key=lambda other: (other.partition(".")[0] != topic, other))[:30])
            raise BadInputError(f"{where}: {file or self.path.name} has no {name!r}; it has: {found}")
        array = arrays[name]
        if array.dtype.kind not in "fiub":
            told = f"{where}: {name!r} in {file or self.path.name} holds no numbers"
            cells = list(enumerate(map(str, array.tolist())))
            wrong = [cell for cell in cells if _number(cell[1].replace(",", ".")) is None] or cells or [(0, "")]
            raise BadInputError(f"{told}: row {wrong[0][0]} (line {wrong[0][0] + 2} of a CSV) has {wrong[0][1]!r}")
        return array

    def _arrays(self, file: str | None) -> Arrays:
        path = self.path if file is None else self.path.with_name(file)
        if path not in self._files:
            if is_lerobot(path):
                self._files[path] = read_episode(path, self.mapping.episode)
            else:
                self._files[path] = read_rows(path, self.mapping) if is_bag(path) else read_arrays(path)
        return self._files[path]

    def _stamps(self) -> NDArray[np.int64]:
        time = self.mapping.time
        if time.source is None:
            assert time.rate_hz is not None  # noqa: S101
            spec = self.mapping.signals["position"]
            n = len(self._columns(spec, "signal position"))
            return RELATIVE_ORIGIN_NS + np.round(np.arange(n) * (1e9 / time.rate_hz)).astype(np.int64)
        raw = self._find(self._arrays(time.file), time.source, "time", time.file)
        return _stamps_of(raw, time)


def _stamps_of(raw: NDArray[Any], time: TimeMapping) -> NDArray[np.int64]:
    if raw.ndim != 1 or not len(raw) or raw.dtype.kind == "b":
        raise BadInputError(f"time: {time.source!r} has shape {raw.shape} of {raw.dtype}; expected one stamp a row")
    if not np.isfinite(raw).all():
        raise BadInputError(f"time: row {int(np.flatnonzero(~np.isfinite(raw))[0])} is not a number")
    backward = np.flatnonzero(np.diff(raw) <= 0)
    if len(backward):
        raise BadInputError(f"time: row {int(backward[0]) + 1} is not after the one before; stamps must rise")
    factor = factor_of(time.unit, "time", "time")
    span_s = float(max(abs(float(raw[0])), abs(float(raw[-1])), abs(float(raw[-1]) - float(raw[0])))) * factor
    if not span_s < LONGEST_S:
        raise BadInputError(f"time: {time.source!r} reaches {span_s:g} s, which no stamp can hold; check its unit")
    if time.clock == "unix":
        if raw.dtype.kind in "iu" and time.unit == "ns":
            return raw.astype(np.int64)
        return np.asarray(np.round(raw.astype(np.float64) * factor * 1e9), dtype=np.int64)
    since_first_ns = np.round((raw - raw[0]).astype(np.float64) * (factor * 1e9))
    return np.asarray(since_first_ns, dtype=np.int64) + RELATIVE_ORIGIN_NS


def _two_axes(array: NDArray[Any], spec: SignalMapping, where: str) -> Array:
    if spec.select is not None:
        if len(spec.select) != array.ndim - 1:
            raise BadInputError(
                f"{where}: select has {len(spec.select)} entries, the array has {array.ndim - 1} axes after the first"
            )
        try:
            array = array[(slice(None), *(slice(None) if i is None else i for i in spec.select))]
        except IndexError as error:
            raise BadInputError(f"{where}: select {list(spec.select)} is out of shape {array.shape}") from error
    if array.ndim == 1:
        array = array[:, None]
    if array.ndim != 2:
        raise BadInputError(f"{where}: the array has shape {array.shape}; choose with 'select' which part to take")
    return array.astype(np.float64)


def _row(value: float | tuple[float, ...], width: int, where: str) -> Array:
    row = np.atleast_1d(np.asarray(value, dtype=np.float64))
    if len(row) not in (1, width):
        raise BadInputError(f"{where} has {len(row)} values; expected 1 or {width}")
    return row


def _scalar_first(values: Array, spec: SignalMapping) -> Array:
    if spec.order is None:
        raise BadInputError("signal odom_from_body: 'order' is missing; allowed: wxyz, xyzw")
    ordered = values if spec.order == "wxyz" else values[:, [3, 0, 1, 2]]
    norm = np.linalg.norm(ordered, axis=1)
    bad = np.flatnonzero(np.abs(norm - 1.0) >= 0.01)  # a blank one is none
    if len(bad):
        raise BadInputError(f"signal odom_from_body: row {int(bad[0])} has norm {norm[bad[0]]:.3g}; expected 1")
    return ordered
