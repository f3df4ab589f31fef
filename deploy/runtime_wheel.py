"""The wheel for a robot's computer: of all packages only those that run there, and only their commands."""

from __future__ import annotations

import base64
import configparser
import hashlib
import io
import zipfile
from pathlib import Path

PACKAGES = ("spot_protos", "spot_model", "spot_log", "spot_runtime", "spot_tools")


def trim(wheel: Path) -> list[str]:
    """Rewrite a wheel without any other package. Returns the names of those that are gone."""
    with zipfile.ZipFile(wheel) as whole:
        contents = {info.filename: whole.read(info) for info in whole.infolist() if not info.is_dir()}
    gone = sorted({name.split("/")[0] for name in contents} - set(PACKAGES))
    gone = [name for name in gone if not name.endswith(".dist-info")]
    kept = {name: data for name, data in contents.items() if name.split("/")[0] not in gone}
    (info,) = {name.split("/")[0] for name in kept if ".dist-info/" in name}
    points = f"{info}/entry_points.txt"
    if points in kept:
        kept[points] = _without(kept[points].decode(), gone).encode()
    tops = f"{info}/top_level.txt"
    if tops in kept:
        kept[tops] = "".join(f"{name}\n" for name in PACKAGES).encode()
    record = f"{info}/RECORD"
    kept[record] = b""
    lines = [f"{name},{_digest(data)},{len(data)}\n" for name, data in kept.items() if name != record]
    kept[record] = "".join([*lines, f"{record},,\n"]).encode()
    unfinished = wheel.with_name(wheel.name + ".new")
    with zipfile.ZipFile(unfinished, "w", zipfile.ZIP_DEFLATED) as trimmed:
        for name, data in kept.items():
            trimmed.writestr(name, data)
    unfinished.replace(wheel)
    return gone


def _without(entry_points: str, packages: list[str]) -> str:
    """The entry points whose modules are still there."""
    parser = configparser.ConfigParser(delimiters=("=",), interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read_string(entry_points)
    for group in parser.sections():
        for name, target in list(parser.items(group)):
            if target.split(":")[0].split(".")[0] in packages:
                parser.remove_option(group, name)
        if not parser.items(group):
            parser.remove_section(group)
    text = io.StringIO()
    parser.write(text)
    return text.getvalue()


def _digest(data: bytes) -> str:
    return "sha256=" + base64.urlsafe_b64encode(hashlib.sha256(data).digest()).rstrip(b"=").decode()
