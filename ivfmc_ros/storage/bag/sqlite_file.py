# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Reads one SQLite file (.db3) of rosbag2_storage_sqlite3: its topics and messages.

The file is opened read-only and its messages are read one at a time. SQLite has no checksums: a
file that ends early or whose pages are inconsistent is found, a wrong bit in a message is not.
"""

from collections import Counter
from collections.abc import Collection
from collections.abc import Iterator
from contextlib import closing
from contextlib import contextmanager
from pathlib import Path
import sqlite3
import struct
import tempfile

from ivfmc_ros.errors import BagError
from ivfmc_ros.storage.bag.bag_file import FileContents
from ivfmc_ros.storage.bag.bag_file import FileDamage
from ivfmc_ros.storage.bag.bag_file import Topic

MAGIC = b'SQLite format 3\0'

# https://www.sqlite.org/fileformat2.html: page size, read version (2: write-ahead log), change
# counter, number of pages, and the change counter for which that number is valid.
_HEADER = struct.Struct('>16x H x B 4x I I 60x I 4x')
_WRITE_AHEAD = 2
_LEAST_PAGE, _HUGE_PAGE = 512, 65536
# Of the number of pages in the header, bytes.
_PAGES_OFFSET = 28
# Seconds to wait for a lock of another program.
_LOCK_S = 1.0
_LOCKED = ('database is locked', 'database table is locked')

# What SQLite raises for damaged files; a wrong length can ask for any memory.
_ERRORS = (sqlite3.Error, MemoryError, OverflowError)

_MESSAGES = 'SELECT id, topic_id, timestamp, data FROM messages WHERE id >= ?'
_TOPICS = 'SELECT id, name, type, serialization_format FROM topics ORDER BY id'
_DEFINITIONS = 'SELECT topic_type, encoding, encoded_message_definition FROM message_definitions'
_MAX_ID = 2**62

_Row = tuple[int, int, int, bytes]


def read_contents(file: Path, *, use_index: bool) -> FileContents:
    """
    Return the topics of a file, as ``BagFormat`` says.

    use_index : False: read every message, also where SQLite can count them without that
    """
    fault = 'is cut off' if _is_cut_off(file) else ''
    with _opened(file) as database:
        topics = _topics(database, file)
        try:
            if fault:
                raise FileDamage(fault)
            counts = _counts(database, topics)
            if not use_index:
                counts = Counter(topic for _, topic, _, _ in _rows(database, topics))
        except FileDamage as damage:
            fault = str(damage)
            counts = Counter(topic for _, topic, _, _ in _intact_rows(database, topics))
    found = [Topic(**{**vars(topic), 'count': counts[key]}) for key, topic in topics.items()]
    return FileContents(topics=found, fault=fault)


def read_messages(
    file: Path,
    topics: Collection[str] | None,
    *,
    salvage: bool,
    validate_crcs: bool = True,
) -> Iterator[tuple[str, int, bytes]]:
    """Yield messages in the order in which they were written, as ``BagFormat`` says."""
    with _opened(file) as database:
        names = {key: topic.name for key, topic in _topics(database, file).items()}
        wanted = {key for key, name in names.items() if topics is None or name in topics}
        rows = _intact_rows(database, wanted) if salvage else _rows(database, wanted)
        for _, topic, log_time_ns, data in rows:
            yield names[topic], log_time_ns, data


def structure_faults(file: Path) -> list[str]:
    """Return what SQLite finds wrong with the pages of a file; every page is read."""
    with _opened(file) as database:
        try:
            found = [str(row[0]) for row in database.execute('PRAGMA quick_check(20)')]
        except _ERRORS as error:
            return [_text(error)]
    return [text for text in found if text != 'ok']


def _is_cut_off(file: Path) -> bool:
    """Return whether a file has fewer pages than its header says."""
    header = _header(file)
    if header is None:
        return True
    page_size, _, changes, pages, valid_for = header
    is_page_size = page_size >= _LEAST_PAGE and page_size & (page_size - 1) == 0
    # what is wrong with another header SQLite says
    is_known = is_page_size and changes == valid_for
    return is_known and file.stat().st_size < pages * page_size


def _header(file: Path) -> tuple[int, ...] | None:
    """Return the fields of ``_HEADER``, None where the file is shorter."""
    with file.open('rb') as stream:
        head = stream.read(_HEADER.size)
    if len(head) < _HEADER.size:
        return None
    page_size, *others = _HEADER.unpack(head)
    # 65536 does not fit into its two bytes
    return page_size if page_size != 1 else _HUGE_PAGE, *others


@contextmanager
def _opened(file: Path) -> Iterator[sqlite3.Connection]:
    """
    Open a file for reading.

    SQLite reads no file that is cut off, and fills the last page with zeros: of such a file the
    whole pages are copied.

    :raises BagError: the file cannot be opened or copied
    """
    try:
        if _is_cut_off(file):
            with tempfile.TemporaryDirectory() as folder:
                copy = Path(folder) / file.name
                _copy_pages(file, copy)
                with _connected(copy) as database:
                    yield database
        else:
            with _connected(file) as database:
                yield database
    except OSError as error:
        raise BagError(f'{file}: cannot be read: {error.strerror or error}') from error


def _copy_pages(file: Path, copy: Path) -> None:
    header = _header(file)
    page_size = header[0] if header else 0
    pages = file.stat().st_size // page_size if page_size else 0
    with file.open('rb') as source, copy.open('wb') as target:
        for _ in range(pages):
            target.write(source.read(page_size))
        if pages:
            target.seek(_PAGES_OFFSET)
            target.write(pages.to_bytes(4, 'big'))


@contextmanager
def _connected(file: Path) -> Iterator[sqlite3.Connection]:
    header = _header(file)
    log = file.with_name(f'{file.name}-wal')
    # without a log there is no writer, and SQLite would make the files of one
    is_final = header is not None and header[1] == _WRITE_AHEAD and not log.exists()
    mode = 'immutable=1' if is_final else 'mode=ro'
    try:
        database = sqlite3.connect(f'{file.resolve().as_uri()}?{mode}', uri=True, timeout=_LOCK_S)
    except sqlite3.Error as error:
        raise BagError(f'{file}: cannot be opened: {error}') from error
    with closing(database):
        database.text_factory = lambda data: data.decode('utf-8', 'replace')
        yield database


def _topics(database: sqlite3.Connection, file: Path) -> dict[int, Topic]:
    """
    Return the topics by their id in the file.

    :raises BagError: the file is locked, not of a bag, or its topics cannot be read
    """
    try:
        tables = {str(row[0]) for row in database.execute('SELECT name FROM sqlite_master')}
        lacking = sorted({'topics', 'messages'} - tables)
        if lacking and _is_cut_off(file):
            raise BagError(f'{file}: is cut off, its topics cannot be read; copy the file again')
        if lacking:
            raise BagError(
                f'{file}: is an SQLite file, but not a bag: it has no table {lacking[0]}; name an '
                '.mcap, .db3 or .bag file, or a bag folder'
            )
        # written from ROS 2 Iron on
        definitions = database.execute(_DEFINITIONS) if 'message_definitions' in tables else ()
        known = {str(kind): (str(how), str(text)) for kind, how, text in definitions}
        return {
            int(key): Topic(
                name=str(name),
                msgtype=str(kind),
                encoding=str(encoding),
                count=0,
                schema_encoding=known.get(str(kind), ('', ''))[0],
                definition=known.get(str(kind), ('', ''))[1],
            )
            for key, name, kind, encoding in database.execute(_TOPICS)
        }
    except (*_ERRORS, ValueError, TypeError) as error:
        raise BagError(f'{file}: {_opening_fault(file, error)}') from error


def _opening_fault(file: Path, error: Exception) -> str:
    text = str(error)
    if text.startswith(_LOCKED):
        return 'is locked by another program; stop its recorder, then read it again'
    for end in ('-wal', '-journal'):
        log = file.with_name(file.name + end)
        if log.exists() and isinstance(error, sqlite3.OperationalError):
            return (
                f'cannot be read together with {log.name}, which its recorder left ({text}); copy '
                f'both to a folder that can be written and run there: sqlite3 {file.name} vacuum'
            )
    return f'its topics cannot be read ({text}); copy the file again'


def _counts(database: sqlite3.Connection, topics: Collection[int]) -> Counter[int]:
    """:raises FileDamage: the messages cannot be counted, or are of no topic."""
    try:
        query = 'SELECT topic_id, count(*) FROM messages GROUP BY topic_id'
        counts = Counter(dict(database.execute(query)))
    except _ERRORS as error:
        raise FileDamage(f'is damaged ({_text(error)})') from error
    lost = sum(count for topic, count in counts.items() if topic not in topics)
    if lost:
        raise FileDamage(f'is damaged ({lost} messages are of topics that it does not list)')
    return counts


def _rows(
    database: sqlite3.Connection, topics: Collection[int], first_id: int = 0
) -> Iterator[_Row]:
    """
    Yield the messages of some topics from an id on, by id, which is the order of writing.

    :raises FileDamage: after the last message before the damage
    """
    # columns of other topics are not loaded, which matters for images
    query = f'{_MESSAGES} AND topic_id IN ({", ".join("?" * len(topics))}) ORDER BY id'
    try:
        for row in database.execute(query, (first_id, *topics)):
            yield _checked(row)
    except _ERRORS as error:
        raise FileDamage(f'is damaged ({_text(error)})') from error


def _checked(row: tuple[object, ...]) -> _Row:
    number, topic, log_time_ns, data = row
    numbers = number, topic, log_time_ns
    if not isinstance(data, bytes) or not all(isinstance(value, int) for value in numbers):
        raise FileDamage(f'is damaged (the row of message {number} is not that of a message)')
    return row  # type: ignore[return-value]


def _intact_rows(database: sqlite3.Connection, topics: Collection[int]) -> Iterator[_Row]:
    """Yield the messages before and behind each damage."""
    start: int | None = 0
    while start is not None:
        try:
            for row in _rows(database, topics, start):
                yield row
                start = row[0] + 1
        except FileDamage:
            start = _readable_from(database, topics, start)
        else:
            return


def _readable_from(
    database: sqlite3.Connection, topics: Collection[int], first_id: int
) -> int | None:
    """Return the smallest id found behind the damage at an id, None where all is damaged."""
    step = 1
    while not _is_readable(database, topics, first_id + step):
        step *= 2
        if first_id + step > _MAX_ID:
            return None
    damaged, readable = step // 2, step
    while readable - damaged > 1:
        middle = (damaged + readable) // 2
        if _is_readable(database, topics, first_id + middle):
            readable = middle
        else:
            damaged = middle
    return first_id + readable


def _is_readable(database: sqlite3.Connection, topics: Collection[int], first_id: int) -> bool:
    try:
        next(_rows(database, topics, first_id), None)
    except FileDamage:
        return False
    return True


def _text(error: BaseException) -> str:
    return str(error) or type(error).__name__
