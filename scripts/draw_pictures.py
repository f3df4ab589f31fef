"""Make the pictures of pages in docs/pictures/ from the pages that commands have written.

python scripts/draw_pictures.py FOLDER [NAME...]

FOLDER holds the outputs of the commands beside the names below. Needs Chromium.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from PIL import Image

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), "chromium")
MOST_BYTES = 200_000
COLOURS = 128


class Shot(NamedTuple):
    """One picture: a page below the folder, and the part of it that matters."""

    page: str
    top: int
    """Where it begins, pixels from the top of the page."""
    height: int
    width: int = 1100
    """Of the window."""


SHOTS = {
    # spot-rl log report LOG.mcap --out log.html
    "log-page": Shot("log.html", 24, 760),
    # python examples/hidden_friction.py hidden
    "diagnosis-page": Shot("hidden/gap/report.html", 24, 900),
    # spot-rl compare LOG hidden/nominal.yaml hidden/gap/corrected_model.yaml --verdict hidden/gap --out three
    "compare-page": Shot("three/compare.html", 24, 800),
    # spot-rl evaluate walk --n 8 --each 4 --out evaluation
    "evaluation-page": Shot("evaluation/evaluation.html", 24, 820),
    # spot-rl sysid fake-walks --policy baseline --config few.yaml --out found
    "sysid-page": Shot("found/report.html", 24, 800),
    # python examples/has_it_changed.py changed
    "has-it-changed": Shot("history/history.html", 24, 880),
    # spot-rl withheld score withheld
    "scores-page": Shot("withheld/scores.html", 24, 700),
}


def draw(name: str, shot: Shot, folder: Path) -> int:
    """Open a page, keep the part that matters with few colours, and return the picture's size in bytes."""
    with tempfile.TemporaryDirectory() as work:
        whole = Path(work) / "page.png"
        words = [CHROMIUM, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run"]
        words += ["--disable-background-networking", "--disable-component-update", "--disable-sync"]
        words += [f"--user-data-dir={work}", f"--window-size={shot.width},{shot.top + shot.height}"]
        words += [f"--screenshot={whole}", (folder / shot.page).resolve().as_uri()]
        subprocess.run(words, check=True, capture_output=True)
        picture = Image.open(whole).convert("RGB").crop((0, shot.top, shot.width, shot.top + shot.height))
        out = PICTURES / f"{name}.png"
        picture.quantize(COLOURS, dither=Image.Dither.NONE).save(out, optimize=True)
    return out.stat().st_size


def main() -> None:
    folder, *names = sys.argv[1:]
    for name in names or SHOTS:
        size = draw(name, SHOTS[name], Path(folder))
        print(f"{name}.png: {size / 1000:.0f} kB")
        if size > MOST_BYTES:
            sys.exit(f"{name}.png is larger than {MOST_BYTES} bytes; show less of the page")


if __name__ == "__main__":
    main()
