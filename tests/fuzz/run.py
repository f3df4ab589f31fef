"""Coverage-guided fuzzing of one parser, or of all, by atheris.

python tests/fuzz/run.py TARGET -runs=1000000        libFuzzer's options follow the name; findings are files crash-*
python tests/fuzz/run.py TARGET FILE                 one input again
python tests/fuzz/run.py all --jobs 4                every parser to 1,000,000 inputs; see campaign.py
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parents[1]), str(HERE)]


def fuzz(name: str, options: list[str]) -> None:
    """Fuzz until the options say that it is enough; the process ends here."""
    import atheris  # type: ignore[import-untyped, import-not-found, unused-ignore]
    from targets import TARGETS

    target = TARGETS[name]
    # Nothing that is written here outlives the process, and a disk would be all that is waited for.
    os.fdatasync = lambda _: None  # type: ignore[assignment]
    with atheris.instrument_imports(include=list(target.watched)):
        seeds = target.seeds()
        for seed in seeds:  # whatever is imported inside functions
            target.run(seed)
    corpus = Path(os.environ.get("FUZZ_CORPUS", ".")) / f"corpus-{name}"
    corpus.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(seeds):
        (corpus / f"seed{number}").write_bytes(seed)
    given = [f"-max_len={target.max_len}", "-rss_limit_mb=3000", "-timeout=30"]
    if target.words:
        words = corpus.with_name(f"words-{name}")
        words.write_text("".join(f'"{_quoted(word)}"\n' for word in target.words))
        given.append(f"-dict={words}")
    is_replay = any(not option.startswith("-") for option in options)
    atheris.Setup([sys.argv[0], *given, *options, *([] if is_replay else [str(corpus)])], target.run)
    atheris.Fuzz()


def _quoted(word: bytes) -> str:
    return "".join(f"\\x{byte:02x}" for byte in word)


def main() -> None:
    """See the module."""
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    if sys.argv[1] == "all":
        from campaign import main as all_of_them

        raise SystemExit(all_of_them(sys.argv[2:]))
    fuzz(sys.argv[1], sys.argv[2:])


if __name__ == "__main__":
    main()
