"""Untrusted YAML: plain data of bounded size, depth and expansion, with errors in plain words.

PyYAML's safe loader makes no objects, but a few hundred bytes of nested aliases expand without end once somebody walks
them, deep nesting ends in the interpreter's recursion limit, and an invalid date raises errors of its own.
"""

from __future__ import annotations

import errno
import os
import re
import stat
from io import BufferedReader
from pathlib import Path
from typing import Any, Final

import yaml

from spot_model.errors import BadInputError


class FileTooLargeError(ValueError):
    """A file, or whatever is behind its name, has more bytes than it may have."""


def open_to_read(path: Path) -> BufferedReader:
    """A file, opened for reading; a pipe without a writer is refused, since opening it would wait for ever.

    Raises:
        OSError: It cannot be opened, is a pipe, or its name is none.
    """
    try:
        file = open(path, "rb", opener=_without_waiting)  # noqa: SIM115 - for the caller
    except ValueError as error:
        raise OSError(errno.EINVAL, str(error), str(path)) from error
    if stat.S_ISFIFO(os.fstat(file.fileno()).st_mode):
        file.close()
        raise OSError(errno.EINVAL, "it is a pipe and no file", str(path))
    return file


def read_at_most(path: Path, max_bytes: int) -> bytes:
    """A file's content; a device that never ends is read no further than any other file.

    Raises:
        FileTooLargeError: There is more.
        OSError: It cannot be read.
    """
    with open_to_read(path) as file:
        data = file.read(max_bytes + 1) or b""  # a terminal without input returns None
    if len(data) > max_bytes:
        raise FileTooLargeError(f"it has more bytes than are allowed: at most {max_bytes}")
    return data


def _without_waiting(path: str, flags: int) -> int:
    return os.open(path, flags | os.O_NONBLOCK)


MAX_BYTES: Final = 1024 * 1024
MAX_VALUES: Final = 200_000
"""Values of a document with all aliases written out."""

MAX_DEPTH: Final = 50
MAX_INT_BITS: Final = 128


class YamlError(ValueError):
    """A text is not the plain, bounded YAML that is taken here; the message says why."""


_PROBLEMS: Final = (
    yaml.YAMLError,
    UnicodeDecodeError,
    ValueError,
    TypeError,
    OverflowError,
    RecursionError,
    # Of PyYAML itself: a number that is only a sign or an underscore, a tag without a value.
    IndexError,
    KeyError,
    AttributeError,
)
"""An invalid date or number, a value that cannot be a key, a mapping that contains itself."""


_OLD_NUMBER: Final = re.compile(r"[-+]?(?:0[0-9_]+|[0-9_]+(?::[0-9_.]+)+)")


class _Loader(yaml.SafeLoader):
    """Plain YAML without constructs that are never intended.

    Refused: nesting beyond any use, before the recursion limit does it; a key that comes twice, of which YAML would
    silently take the last; a NUL character, which no name and no path may hold; numbers that YAML 1.1 reads in a way of
    its own, 1:30 as 90 and 010 as 8, and those of hundreds of digits. And 1e-3 is a number, as in YAML 1.2.
    """

    _depth = 0

    def compose_node(self, parent: yaml.Node | None, index: int) -> yaml.Node | None:
        self._depth += 1
        if self._depth > MAX_DEPTH:
            raise YamlError(f"it is nested more than {MAX_DEPTH} deep")
        node = super().compose_node(parent, index)
        self._depth -= 1
        if isinstance(node, yaml.ScalarNode):
            _refuse_old_numbers(node)
        if isinstance(node, yaml.MappingNode):
            _refuse_repeated_keys(node)
        if isinstance(node, yaml.ScalarNode) and "\0" in node.value:
            raise YamlError(f"line {node.start_mark.line + 1} holds a NUL character")
        return node

    def construct_yaml_int(self, node: yaml.ScalarNode) -> int:
        number = int(super().construct_yaml_int(node))
        if number.bit_length() > MAX_INT_BITS:
            raise YamlError(f"line {node.start_mark.line + 1}: a whole number has more than {MAX_INT_BITS} bits")
        return number


_Loader.add_constructor("tag:yaml.org,2002:int", _Loader.construct_yaml_int)

_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float", re.compile(r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)[eE][-+]?[0-9]+\Z"), list("-+0123456789.")
)


def _refuse_old_numbers(node: yaml.ScalarNode) -> None:
    if node.style is None and node.tag.endswith((":int", ":float")) and _OLD_NUMBER.fullmatch(node.value):
        line, value = node.start_mark.line + 1, node.value[:80]
        raise YamlError(f"line {line}: {value} is a number to some and none to others; write it plainly, or in quotes")


def _refuse_repeated_keys(node: yaml.MappingNode) -> None:
    seen: set[tuple[str, str]] = set()
    for key, _ in node.value:
        if isinstance(key, yaml.ScalarNode) and key.tag != "tag:yaml.org,2002:merge":
            if (key.tag, key.value) in seen:
                raise YamlError(f"line {key.start_mark.line + 1}: the key {key.value[:80]!r} comes twice; keep one")
            seen.add((key.tag, key.value))


def parse_yaml(text: str | bytes) -> Any:
    """Plain data from one YAML document; None where it is empty.

    Raises:
        YamlError: It is not YAML, asks for objects, or is too large, too deep, or endless through its aliases.
    """
    if len(text) > MAX_BYTES:
        raise YamlError(f"it has more bytes than are allowed: at most {MAX_BYTES}")
    loader: _Loader | None = None
    try:
        loader = _Loader(text.decode("utf-8") if isinstance(text, bytes) else text)
        node = loader.get_single_node()
        if node is None:
            return None
        if _expanded(node, {}) > MAX_VALUES:
            raise YamlError(f"it holds more than {MAX_VALUES} values once its aliases are written out")
        return loader.construct_document(node)
    except YamlError:
        raise
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f"line {mark.line + 1}, column {mark.column + 1}: " if mark is not None else ""
        begun = f"{error.context}, " if str(error.problem).startswith("but") else ""
        raise YamlError(f"{where}{begun}{error.problem or error.context}") from error
    except UnicodeDecodeError as error:
        raise YamlError(f"byte {error.start} is no UTF-8 text") from error
    except _PROBLEMS as error:
        raise YamlError(" ".join(str(error).split()) or type(error).__name__) from error
    finally:
        if loader is not None:
            loader.dispose()


def read_yaml(path: Path, what: str) -> Any:
    """Plain data from a YAML file; ``what`` names it in errors.

    Raises:
        BadInputError: The file cannot be read, or is not such YAML.
    """
    try:
        data = read_at_most(path, MAX_BYTES)
        return parse_yaml(data)
    except OSError as error:
        raise BadInputError(f"{what} {path} cannot be read: {error.strerror or error}; give a YAML file") from error
    except (FileTooLargeError, YamlError) as error:
        raise BadInputError(f"{what} {path} is not valid YAML: {error}") from error


def _expanded(node: yaml.Node, known: dict[int, int]) -> int:
    """How many values a node holds with all aliases written out; one that holds itself counts as endless."""
    if id(node) not in known:
        known[id(node)] = MAX_VALUES + 1  # while it is being counted
        inner: list[yaml.Node] = []
        if isinstance(node, yaml.SequenceNode):
            inner = node.value
        elif isinstance(node, yaml.MappingNode):
            inner = [part for pair in node.value for part in pair]
        known[id(node)] = 1 + sum(_expanded(part, known) for part in inner)
    return known[id(node)]
