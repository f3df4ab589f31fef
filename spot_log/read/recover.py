"""Recover a cut or damaged log, check the result, and report what is lost."""

from __future__ import annotations

import fcntl
import os
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from mcap.records import Attachment, Metadata

from spot_log.errors import ASIDE_SUFFIX, LogError, LogReadError, MissingHeaderError, NotAnMcapError
from spot_log.format.codec import ALL_TOPICS, FOOTER, HEADER, OWN_TOPICS
from spot_log.read.mcap_scan import RawMessage, Scan, scan_mcap
from spot_log.read.reader import RECOVERED, header_copies, header_of, read_log_file, read_run
from spot_log.write.mcap_file import CHUNK_BYTES, McapFile
from spot_log.write.run_writer import ACTIVE_SUFFIX, HEADER_ATTACHMENT, active_path, check_can_start
from spot_protos import log_pb2

FIRST_FOREIGN_CHANNEL: Final = 100
"""Number of the first channel that is not ours."""


@dataclass(frozen=True)
class Recovery:
    """What came of one recovery."""

    source: Path
    result: Path
    kept: dict[str, int]
    """Messages in the result by topic."""
    damage: tuple[str, ...]
    """What could not be read; empty where the source was whole."""


def recover_log(source: Path, result: Path) -> Recovery:
    """Copy every readable message of ``source`` to the new log ``result``.

    Raises:
        LogReadError: There is nothing to recover: no MCAP file, or no header.
        LogExistsError: ``result`` exists.
        LogError: The result does not hold what was read; it is removed.
        OSError: A file cannot be read or written.
    """
    check_can_start(result)
    data = read_log_file(source)
    scan = scan_mcap(data)
    if not scan.is_mcap:
        raise NotAnMcapError(source, len(data))
    header_of(source, scan)
    messages = _messages_to_keep(source, scan)
    file = McapFile(active_path(result), ALL_TOPICS)
    try:
        _write(file, messages, scan)
        _verify(active_path(result), messages)
        os.link(active_path(result), result)
    except OSError as error:
        error.filename = error.filename or str(result)
        raise
    finally:
        file.close()
        active_path(result).unlink()
    counts = Counter(message.topic.removeprefix("/") for message in messages)
    kept = {topic.name[1:]: counts[topic.name[1:]] for topic in OWN_TOPICS} | counts
    return Recovery(source, result, kept, _damage(scan))


def recover_leftovers(directory: Path) -> list[Recovery]:
    """Recover every log in ``directory`` that a crash has left ``.active``; one that is being written is left alone.

    A leftover that was only cut is removed after its recovery; one that is damaged inside is kept as ``.damaged``.
    A leftover that holds nothing to recover keeps its name. A recovery that was killed is done again.

    Raises:
        OSError: The directory cannot be read, or a result cannot be written.
    """
    for aside in sorted(directory.glob(f"*{ASIDE_SUFFIX}")):
        _take_back(aside)
    found = [_recover_leftover(leftover) for leftover in sorted(directory.glob(f"*{ACTIVE_SUFFIX}"))]
    return [recovery for recovery in found if recovery is not None]


def _recover_leftover(leftover: Path) -> Recovery | None:
    log = leftover.with_name(leftover.name.removesuffix(ACTIVE_SUFFIX))
    aside = log.with_name(log.name + ASIDE_SUFFIX)
    # A pipe of that name would be waited for without end, and a link leads to what is no log of ours.
    if leftover.is_symlink() or not leftover.is_file() or aside.exists():
        return None
    with _held(leftover) as is_ours:
        if not is_ours:
            return None
        if log.exists() and log.samefile(leftover):
            leftover.unlink()  # whole: its writer died before it removed the old name
            return None
        result = _free_name(log)
        # The name in the making is the leftover's own, so move that away first.
        leftover.rename(aside)
        try:
            recovery = recover_log(aside, result)
        except (LogReadError, LogError, OSError):
            aside.rename(leftover)
            return None
        except BaseException:  # when interrupted, the leftover stays where it was
            aside.rename(leftover)
            raise
        if len(recovery.damage) <= 1:
            aside.unlink()
        return recovery


def _take_back(aside: Path) -> None:
    """Give a leftover its name back whose recovery was killed; a result that was begun holds nothing else."""
    log = aside.with_name(aside.name.removesuffix(ASIDE_SUFFIX))
    begun = active_path(log)
    if log.exists() or aside.is_symlink() or not aside.is_file():
        return
    with _held(aside) as is_ours:
        if is_ours and not (begun.exists() and _is_locked(begun)):
            aside.replace(begun)


def _free_name(path: Path) -> Path:
    number, name = 1, path
    while name.exists():
        name, number = path.with_name(f"{path.stem}.recovered-{number}{path.suffix}"), number + 1
    return name


@contextmanager
def _held(path: Path) -> Iterator[bool]:
    """Hold a file's lock for a while; False where somebody else has it: its writer, or another recovery."""
    fd = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    try:
        fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        is_ours = False
    else:
        is_ours = True
    try:
        yield is_ours
    finally:
        os.close(fd)


def _is_locked(path: Path) -> bool:
    with _held(path) as is_ours:
        return not is_ours


def _damage(scan: Scan) -> tuple[str, ...]:
    return (*scan.damage, *(f"lost for certain: {count} of {topic}" for topic, count in sorted(scan.lost.items())))


def _messages_to_keep(source: Path, scan: Scan) -> list[RawMessage]:
    messages = list(scan.messages)
    if not any(message.topic == HEADER.name for message in messages):
        copy = next(iter(header_copies(scan)), None)
        if copy is None:
            raise MissingHeaderError(source, sorted(scan.counts))
        started_ns = max(0, log_pb2.Header.FromString(copy).started_host_stamp_ns)
        messages.insert(0, RawMessage(HEADER.name, HEADER.schema_name, 0, started_ns, started_ns, copy))
    if not any(message.topic == FOOTER.name for message in messages):
        messages.append(_footer(messages, scan))
    return messages


def _footer(messages: list[RawMessage], scan: Scan) -> RawMessage:
    counts = Counter(message.topic[1:] for message in messages)
    own = {topic.name[1:]: counts[topic.name[1:]] for topic in OWN_TOPICS if topic not in (HEADER, FOOTER)}
    # Stamps of a damaged or hostile file fill all 64 bits; a footer's are signed.
    last_ns = min(max(message.log_ns for message in messages), (1 << 63) - 1)
    footer = log_pb2.Footer(
        host_stamp_ns=last_ns,
        messages=own,
        dropped=_gaps(messages),
        outcome=RECOVERED + "; ".join(scan.damage or ["the log was not closed"]),
    )
    return RawMessage(FOOTER.name, FOOTER.schema_name, 0, last_ns, last_ns, footer.SerializeToString())


def _gaps(messages: list[RawMessage]) -> dict[str, int]:
    """Messages missing between the first number of a topic, 0, and its highest."""
    own = [message for message in messages if message.topic in {topic.name for topic in OWN_TOPICS}]
    highest: dict[str, int] = {}
    for message in own:
        highest[message.topic[1:]] = max(highest.get(message.topic[1:], 0), message.sequence + 1)
    counts = Counter(message.topic[1:] for message in own)
    own_names = [name for name in sorted(highest) if name not in ("header", "footer")]
    # A hostile file has one number twice.
    return {name: max(0, highest[name] - counts[name]) for name in own_names}


def _write(file: McapFile, messages: list[RawMessage], scan: Scan) -> None:
    """Write all messages, also those of topics that are not ours, and what lies outside the chunks."""
    header = next(message for message in messages if message.topic == HEADER.name)
    file.attach(HEADER_ATTACHMENT, "application/x-protobuf", header.data, header.log_ns)
    others: list[Attachment | Metadata] = [a for a in scan.attachments if a.name != HEADER_ATTACHMENT]
    for record in others + scan.metadata:
        file.keep(record)
    channels = {(topic.name, topic.schema_name): topic.channel_id for topic in ALL_TOPICS}
    foreign = [key for key in dict.fromkeys((m.topic, m.schema_name) for m in messages) if key not in channels]
    for number, key in enumerate(foreign, start=FIRST_FOREIGN_CHANNEL):
        channel, schema = scan.channels[key]
        schema_id = 0 if schema is None else number
        file.declare(replace(channel, id=number, schema_id=schema_id), schema and replace(schema, id=number))
        channels[key] = number
    for message in messages:
        file.add(
            channels[message.topic, message.schema_name],
            message.data,
            log_ns=message.log_ns,
            publish_ns=message.publish_ns,
            sequence=message.sequence,
        )
        if file.buffered_bytes >= CHUNK_BYTES:
            file.flush()
    file.finish()


def _verify(path: Path, messages: list[RawMessage]) -> None:
    """Read the result again: it must hold the same messages, and be a log. Raises LogError: it does not."""
    scan = scan_mcap(path.read_bytes())
    if scan.damage or [m[2:] for m in scan.messages] != [m[2:] for m in messages]:
        raise LogError(f"{path}: the recovered log does not hold what was written; check the disk and try again")
    read_run(path)
