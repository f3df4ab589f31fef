"""The recording itself: arrays by name, from NPZ, CSV, Parquet or HDF5."""

from __future__ import annotations

import csv
import struct
import tokenize
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any, BinaryIO, Final

import numpy as np
from numpy.typing import NDArray

from spot_model.errors import BadInputError

Arrays = dict[str, NDArray[Any]]

MAX_UNPACKED_BYTES: Final = 8 << 30
# What zipfile, zlib and NumPy's own reader of headers raise on files that are damaged, encrypted or made to harm.
_NPZ_ERRORS: Final = (
    ValueError,
    TypeError,
    KeyError,
    AttributeError,
    EOFError,
    MemoryError,
    OverflowError,
    RuntimeError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zipfile.BadZipFile,
    zlib.error,
)


def read_arrays(path: Path) -> Arrays:
    """Read every array or column of a file, by name.

    Raises:
        BadInputError: The format is unknown, the file is not of it, or the package that reads it is missing.
        OSError: The file cannot be read.
    """
    reader = _READERS.get(path.suffix.lower())
    if reader is None:
        raise BadInputError(
            f"{path}: {path.suffix or 'no suffix'!r} is no known format; allowed: {', '.join(_READERS)}"
        )
    if not path.is_file():
        raise BadInputError(f"{path} {'is no file' if path.exists() else 'does not exist'}; give a recording")
    return reader(path)


def _read_npz(path: Path) -> Arrays:
    try:
        # Opened here, because NumPy leaves a file open that is not an archive.
        with path.open("rb") as file:
            _check_size(file)
            # Object arrays would be unpickled, and a pickle can run code.
            with np.load(file, allow_pickle=False) as data:
                arrays = {name: data[name] for name in data.files}
    except _NPZ_ERRORS as error:
        raise BadInputError(f"{path} cannot be read as NPZ: {str(error) or type(error).__name__}") from error
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
        try:
            rows = list(csv.reader(file))
        except (csv.Error, UnicodeDecodeError) as error:
            raise BadInputError(f"{path} cannot be read as CSV: {error}") from error
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
    return {name: _numbers(column) for name, column in zip(names, columns, strict=True)}


def _numbers(column: tuple[str, ...]) -> NDArray[Any]:
    try:
        return np.array([float(text) if text.strip() else np.nan for text in column])
    except ValueError:
        return np.array(column, dtype=np.str_)


def _read_parquet(path: Path) -> Arrays:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError as error:
        raise BadInputError(f"{path}: Parquet needs pyarrow: pip install 'spot-rl[report]'") from error
    try:
        table = parquet.read_table(path)
    except (ArrowException, ValueError, MemoryError) as error:
        raise BadInputError(f"{path} cannot be read as Parquet: {error}") from error
    return {name: np.asarray(table.column(name).to_pylist()) for name in table.column_names}


def _read_hdf5(path: Path) -> Arrays:
    try:
        import h5py  # type: ignore[import-not-found, import-untyped, unused-ignore]
    except ImportError as error:
        raise BadInputError(f"{path}: HDF5 needs h5py: pip install h5py") from error
    arrays: Arrays = {}

    def take(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset):
            arrays[name] = np.asarray(node)

    try:
        with h5py.File(path, "r") as file:
            file.visititems(take)
    except (OSError, RuntimeError, KeyError, ValueError, TypeError, MemoryError) as error:
        raise BadInputError(f"{path} cannot be read as HDF5: {error}") from error
    return arrays


_READERS: Final[dict[str, Callable[[Path], Arrays]]] = {
    ".npz": _read_npz,
    ".csv": _read_csv,
    ".parquet": _read_parquet,
    ".h5": _read_hdf5,
    ".hdf5": _read_hdf5,
}
