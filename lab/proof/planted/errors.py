"""All planted errors by name."""

from __future__ import annotations

from proof.planted import calls, fields, reports  # noqa: F401 - each enters its own
from proof.planted.planting import ERRORS

__all__ = ["ERRORS"]
