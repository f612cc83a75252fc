"""MCAP files (https://mcap.dev/spec), with and without an index, whole or cut off."""

from __future__ import annotations

import io
import os
import struct
import weakref
import zlib
from pathlib import Path

import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Schema
from mcap.stream_reader import StreamReader

from options.bags.storage import Index, Place, make_index
from options.bags.unpack import MAX_UNPACKED_BYTES, unlz4, unzstd
from swarm.errors import WorldError
from worlds.recent import Recent

MAGIC = b"\x89MCAP0\r\n"
_RECORD = struct.Struct("<BQ")
_MESSAGE = struct.Struct("<HIQQ")
_CHUNK = struct.Struct("<QQQII")
_FOOTER_BYTES = _RECORD.size + 20
_LATEST_NS = 2**63 - 1
_NO_RECORD = 0
"""The specification gives this number to no kind of record; a file with a hole is full of it."""
_MAX_RECORDS = 500_000
"""Of a chunk: recorders begin a new one after a few megabytes."""
_COMPRESSIONS = ("", "lz4", "zstd")
_DAMAGED = (
    McapError,
    ValueError,
    OverflowError,
    MemoryError,
    RuntimeError,
    struct.error,
    zstandard.ZstdError,
)
"""What reading a damaged chunk may raise; it may say that it needs more memory than there is."""
_UNPACKED_CHUNKS = 4
"""Compressed chunks kept unpacked in memory; a recorder makes them about as large as a scan."""


class McapFile:
    """One `.mcap` file. A place is (where the chunk begins, or 0 outside of one; where the message
    begins in the chunk's content or in the file)."""

    def __init__(
        self, path: Path, encodings: tuple[str, ...] = ("cdr",), kind: str = "bag file"
    ) -> None:
        """Opens a file: reads its index, or else walks through its records.

        Args:
            path: of the file.
            encodings: of messages; topics of other encodings are left out.
            kind: what errors call the file.

        Raises WorldError for one that is no MCAP file.
        """
        self.path = path
        self._name = f"{kind} {path}"
        self.cut = ""
        self._unpacked = Recent(_UNPACKED_CHUNKS)
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, Channel] = {}
        self._chunks: list[ChunkIndex] = []
        self._found: dict[int, list[tuple[int, int, int]]] = {}
        try:
            self._file = os.open(path, os.O_RDONLY | os.O_CLOEXEC)
            weakref.finalize(self, os.close, self._file)
            self._size = os.fstat(self._file).st_size
        except OSError as error:
            raise WorldError(f"{self._name} cannot be read: {error}") from error
        if self._bytes(0, len(MAGIC), short=True) != MAGIC:
            raise WorldError(f"{self._name} is not an MCAP file: it does not begin like one")
        if not self._read_summary():
            self._walk()
        self._ids: dict[str, list[int]] = {}
        self.topics: dict[str, str] = {}
        with_messages = self._found.keys() | {
            identity for chunk in self._chunks for identity in chunk.message_index_offsets
        }
        for identity, channel in self._channels.items():
            if identity in with_messages and channel.message_encoding in encodings:
                self._ids.setdefault(channel.topic, []).append(identity)
                self.topics[channel.topic] = self._schemas.get(channel.schema_id, "")

    def index(self, topic: str) -> Index:
        """See `Storage`."""
        times, places = [], []
        for identity in self._ids[topic]:
            found = make_index(self._found.get(identity, []))
            times.append(found.times_ns)
            places.append(found.places)
            for chunk in self._chunks:
                if identity in chunk.message_index_offsets:
                    rows = self._chunk_index(chunk, identity)
                    times.append(rows[:, 0])
                    begins = np.full(len(rows), chunk.chunk_start_offset, dtype=np.int64)
                    places.append(np.stack([begins, rows[:, 1]], axis=1))
        return Index(np.concatenate(times), np.concatenate(places))

    def read(self, place: Place, most: int | None = None) -> bytes:
        """See `Storage`."""
        chunk, offset = place
        if chunk:
            begin, stored, compression = self._chunk_head(chunk)
            if compression:
                return self._within(self._content(chunk), offset, most)
            if not 0 <= offset < stored:
                raise self._outside()
            offset += begin
        _, length = _RECORD.unpack(self._bytes(offset, _RECORD.size))
        size = length - _MESSAGE.size
        if size < 0:
            raise WorldError(f"{self._name} is damaged at byte {offset}")
        size = size if most is None else min(size, most)
        return self._bytes(offset + _RECORD.size + _MESSAGE.size, size)

    def _within(self, content: bytes, offset: int, most: int | None) -> bytes:
        begin = offset + _RECORD.size + _MESSAGE.size
        if offset < 0 or begin > len(content):
            raise self._outside()
        end = offset + _RECORD.size + _RECORD.unpack_from(content, offset)[1]
        return content[begin : end if most is None else min(end, begin + most)]

    def _outside(self) -> WorldError:
        return WorldError(f"{self._name} is damaged: a message lies outside of its chunk")

    def _read_summary(self) -> bool:
        """Whether the file ends as it should and says where its messages are."""
        end = self._bytes(self._size - _FOOTER_BYTES - len(MAGIC), _FOOTER_BYTES + len(MAGIC), True)
        if not end.endswith(MAGIC) or end[0] != Opcode.FOOTER:
            return False
        (summary,) = struct.unpack_from("<Q", end, _RECORD.size)
        if not len(MAGIC) <= summary < self._size:
            return False
        stream = io.BytesIO(self._bytes(summary, self._size - summary))
        try:
            # Nothing of a summary is packed; a chunk that lies in it all the same is not unpacked.
            for record in StreamReader(stream, skip_magic=True, emit_chunks=True).records:
                if isinstance(record, ChunkIndex):
                    self._chunks.append(record)
                else:
                    self._declare(record)
        except (McapError, ValueError, OverflowError, struct.error) as error:
            raise WorldError(f"the summary of {self._name} is damaged: {error!r}") from error
        for chunk in self._chunks:
            places = (chunk.chunk_start_offset, *chunk.message_index_offsets.values())
            if max(places) >= self._size:
                raise WorldError(
                    f"the summary of {self._name} is damaged: it names places beyond the file's end"
                )
        listed = [chunk.message_index_offsets.keys() for chunk in self._chunks]
        if not listed or not all(ids and ids <= self._channels.keys() for ids in listed):
            self._chunks = []
            return False
        return True

    def _walk(self) -> None:
        """Lists all messages by going from record to record; a cut ends it."""
        at = len(MAGIC)
        while at + _RECORD.size <= self._size:
            code, length = _RECORD.unpack(self._bytes(at, _RECORD.size))
            if code in (Opcode.DATA_END, Opcode.FOOTER):
                return
            if code == _NO_RECORD:
                break
            if at + _RECORD.size + length > self._size:
                if code == Opcode.CHUNK:
                    self._walk_rest(at)
                break
            try:
                self._walk_record(code, at, length)
            except WorldError as error:
                self.cut = str(error)
                return
            at += _RECORD.size + length
        self.cut = f"it ends within a record at byte {at}"

    def _walk_record(self, code: int, at: int, length: int) -> None:
        if code in (Opcode.SCHEMA, Opcode.CHANNEL):
            self._note(code, self._bytes(at + _RECORD.size, length))
        elif code == Opcode.MESSAGE:
            self._note_message(self._bytes(at + _RECORD.size, _MESSAGE.size), 0, at)
        elif code == Opcode.CHUNK:
            # Not kept: all chunks come by.
            self._walk_content(self._unpack(at), at)

    def _walk_rest(self, chunk: int) -> None:
        """Lists the whole messages of a chunk that is cut off, unless it is compressed."""
        try:
            begin, _, compression = self._chunk_head(chunk)
            if not compression:
                self._walk_content(self._bytes(begin, self._size - begin), chunk)
        except WorldError:
            return

    def _walk_content(self, content: bytes, chunk: int) -> None:
        at = records = 0
        while at + _RECORD.size <= len(content):
            code, length = _RECORD.unpack_from(content, at)
            begin = at + _RECORD.size
            if code == _NO_RECORD or begin + length > len(content):
                return
            if (records := records + 1) > _MAX_RECORDS:
                raise WorldError(
                    f"the chunk at byte {chunk} of {self._name} has more records than "
                    f"{_MAX_RECORDS}"
                )
            if code == Opcode.MESSAGE:
                self._note_message(content[begin : begin + _MESSAGE.size], chunk, at)
            elif code in (Opcode.SCHEMA, Opcode.CHANNEL):
                self._note(code, content[begin : begin + length])
            at = begin + length

    def _note(self, code: int, body: bytes) -> None:
        stream = ReadDataStream(io.BytesIO(body))
        try:
            self._declare(Schema.read(stream) if code == Opcode.SCHEMA else Channel.read(stream))
        except (McapError, ValueError, struct.error) as error:
            raise WorldError(
                f"a schema or channel of {self._name} is damaged: {error!r}"
            ) from error

    def _note_message(self, head: bytes, chunk: int, at: int) -> None:
        if len(head) < _MESSAGE.size:
            raise self._outside()
        channel, _, logged, _ = _MESSAGE.unpack(head)
        if logged > _LATEST_NS:
            raise WorldError(f"{self._name} is damaged: a message was logged at {logged} ns")
        self._found.setdefault(channel, []).append((logged, chunk, at))

    def _declare(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._schemas[record.id] = record.name
        elif isinstance(record, Channel):
            self._channels[record.id] = record

    def _chunk_index(
        self, chunk: ChunkIndex, channel: int
    ) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        """(N, 2): time and offset of the channel's messages in a chunk."""
        at = chunk.message_index_offsets[channel]
        _, length = _RECORD.unpack(self._bytes(at, _RECORD.size))
        body = self._bytes(at + _RECORD.size, length)
        if len(body) % 16 != 6:
            raise WorldError(f"{self._name} is damaged: an index of {len(body)} bytes is none")
        return np.frombuffer(body[6:], dtype="<i8").astype(np.int64).reshape(-1, 2)

    def _chunk_head(self, chunk: int) -> tuple[int, int, str]:
        """Where a chunk's content begins, how many bytes are stored, and its compression."""
        at = chunk + _RECORD.size
        _, _, _, _, name_bytes = _CHUNK.unpack(self._bytes(at, _CHUNK.size))
        at += _CHUNK.size
        tail = self._bytes(at, name_bytes + 8)
        stored = int.from_bytes(tail[name_bytes:], "little")
        return at + len(tail), stored, tail[:name_bytes].decode("utf-8", errors="replace")

    def _content(self, chunk: int) -> bytes:
        """A chunk's records, unpacked."""
        return self._unpacked.get(chunk, lambda: self._unpack(chunk))

    def _unpack(self, chunk: int) -> bytes:
        _, length = _RECORD.unpack(self._bytes(chunk, _RECORD.size))
        stored = ReadDataStream(io.BytesIO(self._bytes(chunk + _RECORD.size, length)))
        try:
            packed = Chunk.read(stored)
            if packed.compression not in _COMPRESSIONS:
                raise ValueError(
                    f"it is compressed with {packed.compression!r}; allowed: lz4, zstd and none"
                )
            match packed.compression:
                case "zstd":
                    content = unzstd(packed.data, packed.uncompressed_size)
                case "lz4":
                    content = unlz4(packed.data, packed.uncompressed_size)
                case _:
                    content = packed.data
            if packed.uncompressed_crc not in (0, zlib.crc32(content)):
                raise ValueError("its checksum is another one")
            return content
        except _DAMAGED as error:
            raise WorldError(
                f"the chunk at byte {chunk} of {self._name} is damaged: {error!r}"
            ) from error

    def _bytes(self, offset: int, size: int, short: bool = False) -> bytes:
        # A damaged length may ask for more than there is memory for, and the file be sparse.
        if size > MAX_UNPACKED_BYTES:
            raise WorldError(
                f"{self._name} asks for {size} bytes at byte {offset}; allowed: "
                f"{MAX_UNPACKED_BYTES} at a time"
            )
        there = min(size, self._size - offset)
        try:
            found = os.pread(self._file, there, offset) if offset >= 0 and there > 0 else b""
        except OSError as error:
            raise WorldError(f"{self._name} cannot be read: {error}") from error
        if len(found) < size and not short:
            raise WorldError(
                f"{self._name} is damaged: {size} bytes at byte {offset} are not there"
            )
        return found
