"""Labels of a log, as they are given on a command line."""

from __future__ import annotations

import re

from spot_model.errors import BadInputError

LABEL_KEY = re.compile(r"[A-Za-z0-9_.-]{1,64}")
MAX_LABEL_VALUE = 256


def parse_labels(texts: list[str]) -> dict[str, str]:
    """``KEY=VALUE`` pairs.

    Raises:
        BadInputError: One is no such pair, or a key comes twice.
    """
    labels: dict[str, str] = {}
    for text in texts:
        key, equals, value = text.partition("=")
        is_sound = LABEL_KEY.fullmatch(key) and len(value) <= MAX_LABEL_VALUE and value.isprintable()
        if not equals or key in labels or not is_sound:
            raise BadInputError(
                f"label {text[:80]!r} is not valid; allowed: KEY=VALUE, each key once, of letters, digits, '_', '.', "
                f"'-', at most 64; values printable, at most {MAX_LABEL_VALUE}"
            )
        labels[key] = value
    return labels
