"""Names that programs share with the log without reading one."""

from __future__ import annotations

from typing import Final

FOLLOWING_MODE: Final = "active"
"""Mode of the ticks in which the policy follows the velocity command."""

ASIDE_SUFFIX: Final = ".damaged"
"""Of a leftover while it is recovered, and afterwards where it is damaged inside."""
