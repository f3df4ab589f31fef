"""Plotly figures as parts of a page, for pages of many cases; a diagnosis' own page draws without a library."""

from __future__ import annotations

from typing import Any, Final

BLUE, RED, GREY, GREEN = "#2f6fb5", "#c0392b", "#8a97a3", "#2e8b57"
CONFIG: Final = {"displaylogo": False, "responsive": True}


def div(figure: Any, height: int) -> str:
    """A figure without the library."""
    figure.update_layout(
        template="plotly_white",
        height=height,
        margin={"l": 60, "r": 20, "t": 30, "b": 45},
        font={"size": 12},
        legend={"orientation": "h", "y": 1.08},
    )
    return str(figure.to_html(full_html=False, include_plotlyjs=False, config=CONFIG))
