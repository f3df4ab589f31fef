"""What a failed, interrupted or doubled command leaves behind: what was there before, and nothing else."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from spot_model.io import whole
from spot_model.io.whole import (
    OutputExistsError,
    check_new,
    finished,
    whole_file,
    whole_folder,
    write_new,
    write_over,
)


def names(folder: Path) -> list[str]:
    return sorted(str(p.relative_to(folder)) for p in folder.rglob("*"))


@pytest.mark.parametrize("error", [OSError, KeyboardInterrupt])
def test_an_error_while_writing_leaves_nothing(tmp_path: Path, error: type[BaseException]) -> None:
    (tmp_path / "old.txt").write_text("mine")

    def fail() -> None:
        with whole_folder(tmp_path / "new" / "deep") as part:
            (part / "bag").mkdir()
            (part / "bag" / "page.html").write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert names(tmp_path) == ["old.txt"]


def test_files_and_folders_take_their_places(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "notes").write_text("mine")
    with whole_folder(tmp_path / "out") as part:
        (part / "bag").mkdir()
        (part / "bag" / "a").write_text("1")
        (part / "b").write_text("2")
        assert not (tmp_path / "out" / "b").exists()
    assert names(tmp_path / "out") == ["b", "bag", "bag/a", "notes"]
    assert (tmp_path / "out" / "bag" / "a").read_text() == "1"


def test_an_output_that_appears_meanwhile_is_kept_and_all_others_are_taken_back(tmp_path: Path) -> None:
    def race() -> None:
        with whole_folder(tmp_path / "out") as part:
            for name in "abc":
                (part / name).write_text("ours")
            (tmp_path / "out").mkdir()
            (tmp_path / "out" / "b").write_text("theirs")

    with pytest.raises(
        OutputExistsError, match=r"out/b exists; nothing is overwritten: choose another name, or remove"
    ):
        race()
    assert names(tmp_path) == ["out", "out/b"]
    assert (tmp_path / "out" / "b").read_text() == "theirs"


@pytest.mark.parametrize("after", range(4))
def test_an_interruption_between_two_moves_takes_both_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after: int
) -> None:
    move, moved = whole._move, []

    def moving(file: Path, place: Path, *, replace: bool) -> None:
        if len(moved) == after:
            raise KeyboardInterrupt
        move(file, place, replace=replace)
        moved.append(place)
        if len(moved) == after == 3:
            raise KeyboardInterrupt

    monkeypatch.setattr(whole, "_move", moving)

    def write() -> None:
        with whole_folder(tmp_path / "out") as part:
            for name in "abc":
                (part / name).write_text("ours")

    with pytest.raises(KeyboardInterrupt):
        write()
    assert names(tmp_path) == []


def test_of_many_writers_of_one_file_one_wins(tmp_path: Path) -> None:
    path, start, lost = tmp_path / "out" / "page.html", threading.Barrier(8), []

    def write(number: int) -> None:
        with whole_file(path) as part:
            part.write_text(f"{number}" * 1000)
            start.wait()

    def try_to(number: int) -> None:
        try:
            write(number)
        except OutputExistsError:
            lost.append(number)

    writers = [threading.Thread(target=try_to, args=(n,)) for n in range(8)]
    for writer in writers:
        writer.start()
    for writer in writers:
        writer.join()
    (winner,) = set(range(8)) - set(lost)
    assert path.read_text() == f"{winner}" * 1000
    assert names(tmp_path) == ["out", "out/page.html"]


def test_a_killed_writer_leaves_nothing_under_the_outputs_name(tmp_path: Path) -> None:
    path = tmp_path / "page.html"
    program = (
        "import sys; from pathlib import Path; from spot_model.io.whole import whole_file\n"
        "with whole_file(Path(sys.argv[1])) as part:\n"
        "    part.write_text('half'); print('writing', flush=True); sys.stdin.read()\n"
    )
    words = [sys.executable, "-c", program, str(path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"writing\n"
        process.send_signal(signal.SIGKILL)
    assert not path.exists()
    write_new(path, "all")
    assert path.read_text() == "all"


def test_without_hard_links_a_file_moves_too_and_is_not_overwritten(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(errno.EPERM, "Operation not permitted")

    monkeypatch.setattr(Path, "hardlink_to", refuse)
    write_new(tmp_path / "a", "first")

    def race() -> None:
        with whole_folder(tmp_path) as part:
            (part / "0").write_text("ours")
            (part / "a").write_text("ours")

    with pytest.raises(OutputExistsError):
        race()
    assert (tmp_path / "a").read_text() == "first"
    assert names(tmp_path) == ["a"]


def test_write_over_replaces_and_keeps_the_old_file_when_it_fails(tmp_path: Path) -> None:
    path = tmp_path / "state.json"
    write_over(path, "1")
    write_over(path, "2")
    assert path.read_text() == "2"
    with pytest.raises(UnicodeEncodeError):
        write_over(path, "\ud800")
    assert path.read_text() == "2"
    assert names(tmp_path) == ["state.json"]


def test_the_error_of_a_full_disk_names_the_file(tmp_path: Path) -> None:
    with pytest.raises(OSError, match=r"page\.html") as told, whole_file(tmp_path / "page.html"):
        raise OSError(errno.ENOSPC, "No space left on device")
    assert told.value.filename == str(tmp_path / "page.html")


def test_an_error_names_the_output_and_not_where_it_was_written_first(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError) as told, whole_folder(tmp_path) as part:
        (part / "missing" / "a").write_text("")
    assert told.value.filename == str(tmp_path / "missing" / "a")


def test_an_error_that_is_not_the_disks_names_no_file(tmp_path: Path) -> None:
    with pytest.raises(BrokenPipeError) as told, whole_file(tmp_path / "page.html"):
        raise BrokenPipeError(errno.EPIPE, "Broken pipe")
    assert told.value.filename is None


def test_an_output_that_exists_or_could_not_be_written_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    check_new(tmp_path / "new" / "folder")
    (tmp_path / "old").write_text("")
    (tmp_path / "dangling").symlink_to(tmp_path / "nowhere")
    for taken in ("old", "dangling"):
        with pytest.raises(OutputExistsError, match=f"{taken} exists; nothing is overwritten"):
            check_new(tmp_path / "new", tmp_path / taken)
    with pytest.raises(NotADirectoryError, match="is a file, not a folder"):
        check_new(tmp_path / "old" / "page.html")
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write wherever permissions forbid it
    with pytest.raises(PermissionError, match="may not be written to") as told:
        check_new(tmp_path / "new" / "folder")
    assert told.value.filename == str(tmp_path)
    assert not (tmp_path / "new").exists()


def test_unfinished_output_is_not_among_a_folders_files(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_text("whole")
    (tmp_path / "runs").mkdir()
    (tmp_path / "runs" / "b.mcap").write_text("whole")
    with whole_file(tmp_path / "runs" / "c.mcap") as part:
        part.write_text("half")
        assert len(list(tmp_path.rglob("*.mcap"))) == 3
        assert finished(tmp_path, "*.mcap") == [tmp_path / "a.mcap", tmp_path / "runs" / "b.mcap"]
    assert [file.name for file in finished(tmp_path, "*.mcap")] == ["a.mcap", "b.mcap", "c.mcap"]


def test_writing_over_a_link_writes_where_it_points(tmp_path: Path) -> None:
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "file").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "there" / "file")
    write_over(tmp_path / "link", "new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "there" / "file").read_text() == "new"
