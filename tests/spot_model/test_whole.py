"""What a failed or interrupted command leaves behind: what was there before, and nothing else."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import pytest

from spot_model.io.whole import check_writable, whole


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_an_error_takes_back_what_was_made_and_leaves_what_was_there(tmp_path: Path, error: type) -> None:
    old, out = tmp_path / "old.txt", tmp_path / "new" / "deep"
    old.write_text("mine")

    def fail() -> None:
        with whole(out / "page.html", old, tmp_path / "bag"):
            out.mkdir(parents=True)
            (out / "page.html").write_text("half")
            (tmp_path / "bag").mkdir()
            (tmp_path / "bag" / "part").write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert sorted(p.name for p in tmp_path.rglob("*")) == ["old.txt"]
    assert old.read_text() == "mine"


def test_a_folder_in_which_somebody_else_wrote_stays(tmp_path: Path) -> None:
    def fail() -> None:
        with whole(tmp_path / "out" / "a"):
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "a").write_text("half")
            (tmp_path / "out" / "notes").write_text("theirs")
            raise OSError("full")

    with pytest.raises(OSError, match="full"):
        fail()
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["notes"]


def test_without_an_error_everything_stays(tmp_path: Path) -> None:
    with whole(tmp_path / "a"):
        (tmp_path / "a").write_text("all")
    assert (tmp_path / "a").read_text() == "all"


def test_the_error_of_a_full_disk_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"page\.html") as told, whole(tmp_path / "page.html"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert told.value.filename == str(tmp_path / "page.html")


def test_an_error_that_is_not_the_disks_names_no_file(tmp_path: Path) -> None:
    with pytest.raises(BrokenPipeError) as told, whole(tmp_path / "page.html"):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")
    assert told.value.filename is None


def test_an_output_that_could_not_be_written_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    check_writable(tmp_path / "new" / "folder")
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write wherever permissions forbid it
    with pytest.raises(PermissionError, match="may not be written to") as told:
        check_writable(tmp_path / "new" / "folder")
    assert told.value.filename == str(tmp_path)
    assert not (tmp_path / "new").exists()
