"""What the files beside a log are called, for those too that never read one."""

from __future__ import annotations

from typing import Final

ASIDE_SUFFIX: Final = ".damaged"
"""Of a leftover while it is recovered, and afterwards where it is damaged inside."""
