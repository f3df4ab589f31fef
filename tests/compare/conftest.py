from __future__ import annotations

from collections.abc import Callable

import pytest

from compare.tracks import Track

from .tracks import a_track


@pytest.fixture
def make_track() -> Callable[..., Track]:
    """Makes tracks of which every number is known."""
    return a_track
