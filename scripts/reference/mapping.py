"""docs/reference/mapping.md: every key of the mapping with which a recording is imported."""

from __future__ import annotations

from spot_log.importing.mapping import JOINTS, SIGNALS, Mapping, shipped_names
from spot_log.importing.recording import UNITS

from .words import page, sections, table

ABOUT = """\
A mapping says which array or column of [another program's recording](../log.md#import-other-recordings) is which
signal. Whole examples, by name in place of a file: """


def mapping_page() -> str:
    """The page."""
    widths = {JOINTS: "joints", 0: "any"}
    signals = [
        (f"`{name}`", s.quantity, widths.get(s.width, f"{s.width}"), s.record, ", ".join(UNITS[s.quantity]))
        for name, s in SIGNALS.items()
    ]
    return page(
        "Mapping of an import",
        ABOUT + ", ".join(f"`{name}`" for name in shipped_names()) + ".",
        [
            *sections(Mapping),
            "### Names, quantities and units\n\n`position` is needed. The log has the first unit of each row.\n",
            table(("signal", "quantity", "columns", "record", "units"), signals),
        ],
    )
