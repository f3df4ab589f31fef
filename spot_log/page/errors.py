"""Errors of pages."""

from __future__ import annotations

from spot_model.errors import BadInputError


class ReportError(BadInputError):
    """A page cannot be made; the message says why and what to do."""
