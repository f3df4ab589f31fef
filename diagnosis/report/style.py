"""Where the page's look lay before it served other pages too."""

from spot_log.page.look import SCRIPT, STYLE

__all__ = ["SCRIPT", "STYLE"]
