"""Labels of a log: what they may be, and how they are given on a command line."""

from __future__ import annotations

import re

from spot_model.errors import BadInputError

_KEY = re.compile(r"[A-Za-z0-9_.-]{1,64}")
MAX_VALUE = 256
RULE = f"keys of at most 64 letters, digits, '_', '.' and '-', printable values of at most {MAX_VALUE}"


def is_label(key: str, value: str) -> bool:
    """Whether a log may carry this label: letters, digits, '_', '.', '-' in the key, something printable as value."""
    return bool(_KEY.fullmatch(key)) and len(value) <= MAX_VALUE and value.isprintable()


def parse_labels(texts: list[str]) -> dict[str, str]:
    """``KEY=VALUE`` pairs. Raises BadInputError: one is not such a pair, or a key comes twice."""
    labels: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        if not equals or key in labels or not is_label(key, value):
            raise BadInputError(f"label {text[:80]!r} is not valid; allowed: KEY=VALUE, each key once, {RULE}")
        labels[key] = value
    return labels
