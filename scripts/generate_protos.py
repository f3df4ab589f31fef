"""Generate spot_protos/ from protos/, or check that what is committed is what would be generated.

python scripts/generate_protos.py            write spot_protos/*_pb2.py and *.pyi
python scripts/generate_protos.py --check    write nothing; exit 1 and name the files that differ
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from importlib.resources import files
from pathlib import Path

from grpc_tools import protoc

REPOSITORY = Path(__file__).resolve().parent.parent
PROTO_ROOT = REPOSITORY / "protos"
PACKAGE = "spot_protos"
GENERATED = "*_pb2*.py*"


def generate(out: Path) -> None:
    """Write the generated package under ``out``. Raises SystemExit when the compiler refuses a file."""
    (out / PACKAGE).mkdir(exist_ok=True)
    well_known = str(files("grpc_tools") / "_proto")
    for proto in sorted((PROTO_ROOT / PACKAGE).glob("*.proto")):
        arguments = ["protoc", f"-I{PROTO_ROOT}", f"-I{well_known}", f"--python_out={out}", f"--pyi_out={out}"]
        if protoc.main([*arguments, str(proto)]) != 0:
            raise SystemExit(f"protoc refused {proto.relative_to(REPOSITORY)}; its message stands above")


def generated_files(root: Path) -> dict[str, bytes]:
    """Return the generated files under ``root`` by name."""
    return {path.name: path.read_bytes() for path in (root / PACKAGE).glob(GENERATED)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    is_check = parser.parse_args().check
    with tempfile.TemporaryDirectory() as folder:
        generate(Path(folder))
        fresh, committed = generated_files(Path(folder)), generated_files(REPOSITORY)
    different = sorted(name for name in fresh.keys() | committed.keys() if fresh.get(name) != committed.get(name))
    if is_check:
        if different:
            sys.exit(f"{PACKAGE}/ differs from protos/ in {', '.join(different)}; run 'make protos' and commit")
        return
    for name in different:
        path = REPOSITORY / PACKAGE / name
        if name in fresh:
            path.write_bytes(fresh[name])
        else:
            path.unlink()
        print(f"{'wrote' if name in fresh else 'removed'} {PACKAGE}/{name}")


if __name__ == "__main__":
    main()
