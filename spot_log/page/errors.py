"""Errors of pages."""

from __future__ import annotations

from spot_model.errors import BadInputError


class ReportError(BadInputError):
    """A page cannot be made; the message says why and what to do."""


class PlotlyMissingError(ReportError):
    """The package that draws is not installed."""

    def __init__(self) -> None:
        super().__init__("pages need plotly, which is not installed: pip install 'spot-rl[report]'")
