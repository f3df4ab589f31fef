"""Where the figures' pieces of SVG lay before they served other pages too."""

from spot_log.page.svg import disc, esc, heat, legend, line, nice_ticks, on_heat, rect, svg, text, thinned

__all__ = ["disc", "esc", "heat", "legend", "line", "nice_ticks", "on_heat", "rect", "svg", "text", "thinned"]
