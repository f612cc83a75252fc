"""The channels of one recording: to a file, to Foxglove as it happens, or both."""

from __future__ import annotations

from typing import Any

import foxglove
import msgspec
from foxglove import channels
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from foxglove.messages import FrameTransforms, Log, PointCloud, PoseInFrame, SceneUpdate
from foxglove.websocket import WebSocketServer

from options.recordings.sink import Sink
from options.ros.definitions import definition
from swarm.errors import RecordingError

LIVE_HOST = "127.0.0.1"
# Measured: half as large as with lz4, at no more processor time than without; its own threads would
# take the cores from the swarm.
_PACKED = MCAPWriteOptions(compression=MCAPCompression.Zstd, compression_threads=0)
_KINDS: dict[type, Any] = {
    PointCloud: channels.PointCloudChannel,
    SceneUpdate: channels.SceneUpdateChannel,
    FrameTransforms: channels.FrameTransformsChannel,
    PoseInFrame: channels.PoseInFrameChannel,
    Log: channels.LogChannel,
}
Shape = PointCloud | SceneUpdate | FrameTransforms | PoseInFrame | Log


class Outlet:
    """Where a recording goes. A topic is advertised with its first message."""

    def __init__(self, sink: Sink | None, live_port: int | None = None, name: str = "") -> None:
        """Writes to `sink`, and serves Foxglove's WebSocket on a port of LIVE_HOST (0: a free one).

        Raises RecordingError when the port cannot be taken.
        """
        self._context = foxglove.Context()
        self._channels: dict[str, Any] = {}
        self._sink = sink
        self._server: WebSocketServer | None = None
        self._writer: foxglove.MCAPWriter | None = None
        if live_port is not None:
            try:
                self._server = foxglove.start_server(
                    name=name, host=LIVE_HOST, port=live_port, context=self._context
                )
            except (RuntimeError, OverflowError) as error:
                raise RecordingError(
                    f"port {live_port} on {LIVE_HOST}, for Foxglove (--live), cannot be taken: "
                    f"{error}"
                ) from error
        if sink is not None:
            self._writer = foxglove.open_mcap(sink, context=self._context, writer_options=_PACKED)

    @property
    def port(self) -> int | None:
        """Where Foxglove can connect; None without a server."""
        return None if self._server is None else self._server.port

    def put(self, topic: str, message: Shape, time_ns: int) -> None:
        """A message in one of Foxglove's schemas."""
        if topic not in self._channels:
            self._channels[topic] = _KINDS[type(message)](topic, context=self._context)
        self._channels[topic].log(message, log_time=time_ns)

    def put_json(self, topic: str, message: msgspec.Struct, time_ns: int) -> None:
        """A struct as JSON, with its schema."""
        if topic not in self._channels:
            self._channels[topic] = foxglove.Channel(
                topic, schema=schema_of(type(message)), context=self._context
            )
        self._channels[topic].log(msgspec.json.encode(message), log_time=time_ns)

    def put_ros(self, topic: str, kind: str, message: bytes, time_ns: int) -> None:
        """A ROS 2 message in CDR, with its type's definition; `kind`: `nav_msgs/msg/OccupancyGrid`
        and so on."""
        if topic not in self._channels:
            schema = foxglove.Schema(name=kind, encoding="ros2msg", data=definition(kind).encode())
            self._channels[topic] = foxglove.Channel(
                topic, schema=schema, message_encoding="cdr", context=self._context
            )
        self._channels[topic].log(message, log_time=time_ns)

    def flush(self) -> None:
        """What came so far outlives a crash of this process; a failure is in the sink's `error`."""
        if self._writer is not None and self._sink is not None:
            try:
                self._writer.flush()
            except RuntimeError as error:
                self._sink.error = self._sink.error or str(error)

    def close(self) -> None:
        """Writes the index, and says goodbye to viewers. What failed is in the sink's `error`."""
        for channel in self._channels.values():
            channel.close()
        if self._writer is not None and self._sink is not None:
            try:
                self._writer.close()
            except RuntimeError as error:
                self._sink.error = self._sink.error or str(error)
            self._sink.close()
        if self._server is not None:
            self._server.stop()


def schema_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """The JSON schema of a struct: an object at its top, as Foxglove wants it."""
    (_,), parts = msgspec.json.schema_components([kind], ref_template="#/$defs/{name}")
    own = dict(parts.pop(kind.__name__))
    own["title"] = f"coadapt.{kind.__name__}"
    return own | ({"$defs": parts} if parts else {})
