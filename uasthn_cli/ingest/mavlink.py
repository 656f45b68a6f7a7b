"""Read and write MAVLink telemetry logs (``.tlog``): the only room that imports pymavlink."""

import logging
import mmap
import os
from collections import defaultdict
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, Final

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as dialect

from uasthn_cli.errors import LogUnreadableError, NoPositionError, OutputError
from uasthn_cli.ingest.messages import READERS, Reading
from uasthn_cli.ingest.telemetry import (
    Attitudes,
    CameraEvents,
    GimbalAttitudes,
    HeightSamples,
    Positions,
    Stamps,
    SystemTimes,
    Telemetry,
)
from uasthn_cli.ingest.tlog import (
    TIME_BYTES,
    Buffer,
    Packet,
    foreign_format,
    iterate_packets,
    record_time_s,
)
from uasthn_cli.types import FloatArray

_log = logging.getLogger(__name__)

_NAME_OF: Final[dict[int, str]] = {
    getattr(dialect, f"MAVLINK_MSG_ID_{name}"): name for name in READERS
}
_CAMERA_MESSAGES: Final = ("CAMERA_IMAGE_CAPTURED", "CAMERA_FEEDBACK", "CAMERA_TRIGGER")
_GIMBAL_MESSAGES: Final = ("GIMBAL_DEVICE_ATTITUDE_STATUS", "MOUNT_ORIENTATION")
_HEIGHT_MESSAGES: Final = (
    ("DISTANCE_SENSOR", "distance_sensor", True),
    ("RANGEFINDER", "rangefinder", True),
    ("TERRAIN_REPORT", "terrain_report", False),
)
"""Message, height source, slant range: a DISTANCE_SENSOR tells its limits, so it comes first."""

_Row = tuple[int, float, Reading]
_Vehicle = tuple[int, int]
_Rows = dict[str, dict[_Vehicle, list[_Row]]]


def read_telemetry(path: Path) -> Telemetry:
    """Read what a prior needs from a ``.tlog``, of the vehicle that sent most positions.

    Damaged packets are left out (their checksum tells); the rest is kept as recorded.

    Raises:
        LogUnreadableError: the file is missing, empty or not a ``.tlog``.
        NoPositionError: the log holds no position or no attitude.
    """
    with _mapped(path) as data:
        kind = foreign_format(data)
        if kind is not None:
            raise LogUnreadableError(
                f"{path} is {kind}; give the ground station's .tlog of the same flight"
            )
        rows, packets = _collect(data)
    if packets == 0:
        raise LogUnreadableError(
            f"{path} is not a MAVLink .tlog: no intact telemetry message in it; give the log that"
            " the ground station recorded"
        )
    telemetry = _assemble(path, rows)
    _log.info(
        "%s: vehicle %d/%d, %d positions (%s), %d attitudes",
        path.name,
        *telemetry.vehicle,
        len(telemetry.positions.stamps),
        telemetry.positions.message,
        len(telemetry.attitudes.stamps),
    )
    return telemetry


@contextmanager
def _mapped(path: Path) -> Iterator[Buffer]:
    """Open a log as a read-only buffer; logs of hours need no memory of their own."""
    if path.is_dir():
        raise LogUnreadableError(f"{path} is a folder; give the .tlog file itself")
    try:
        with path.open("rb") as handle:
            if os.fstat(handle.fileno()).st_size == 0:
                raise LogUnreadableError(f"{path} is empty (0 bytes): the log was never written")
            with mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) as data:
                yield data
    except FileNotFoundError as error:
        raise LogUnreadableError(f"{path} does not exist; check the path of the .tlog") from error
    except OSError as error:
        reason = error.strerror or error
        raise LogUnreadableError(f"{path} cannot be read: {reason}") from error


def _collect(data: Buffer) -> tuple[_Rows, int]:
    """Return valid readings by message name and vehicle, and the number of intact messages."""
    decoder = dialect.MAVLink(None)

    def decode(packet: Packet) -> Any | None:
        try:
            return decoder.decode(bytearray(data[packet.start : packet.end]))
        except dialect.MAVError:
            return None

    rows: _Rows = defaultdict(lambda: defaultdict(list))
    packets = 0
    for ordinal, packet, message in iterate_packets(data, frozenset(_NAME_OF), decode):
        packets += 1
        name = _NAME_OF[packet.message_id]
        reading = READERS[name](message)
        if reading is not None:
            row = (ordinal, record_time_s(data, packet), reading)
            rows[name][packet.system, packet.component].append(row)
    return rows, packets


def _assemble(path: Path, rows: _Rows) -> Telemetry:
    """Return the telemetry of the vehicle that sent most positions."""
    message = "GLOBAL_POSITION_INT" if rows["GLOBAL_POSITION_INT"] else "GPS_RAW_INT"
    senders = rows[message]
    if not senders:
        raise NoPositionError(
            f"{path} holds no valid position (GLOBAL_POSITION_INT or GPS_RAW_INT): the vehicle had"
            " no fix, or another log is meant"
        )
    vehicle = max(senders, key=lambda sender: (len(senders[sender]), -sender[0], -sender[1]))
    if len(senders) > 1:
        _log.warning(
            "%s holds positions of %d senders; vehicle %d/%d has most and is used",
            path.name,
            len(senders),
            *vehicle,
        )
    attitudes = rows["ATTITUDE"].get(vehicle) or _of_system(rows, "ATTITUDE", vehicle)
    if not attitudes:
        raise NoPositionError(f"{path} holds positions of vehicle {vehicle[0]} but no ATTITUDE")
    system_times = _of_system(rows, "SYSTEM_TIME", vehicle)
    return Telemetry(
        path=path,
        vehicle=vehicle,
        positions=_positions(message, senders[vehicle]),
        attitudes=Attitudes(_stamps(attitudes), *_columns(attitudes, 3)),
        system_times=SystemTimes(_stamps(system_times), _columns(system_times, 1)[0]),
        camera_events=tuple(
            _camera_events(name, found)
            for name in _CAMERA_MESSAGES
            if (found := _of_system(rows, name, vehicle))
        ),
        gimbal=_gimbal(rows, vehicle),
        heights=tuple(
            HeightSamples(_stamps(found), _columns(found, 1)[0], source, along_body_axis)
            for name, source, along_body_axis in _HEIGHT_MESSAGES
            if (found := _of_system(rows, name, vehicle))
        ),
    )


def _of_system(rows: _Rows, name: str, vehicle: _Vehicle) -> list[_Row]:
    """Return one message's rows of all components of a vehicle (camera, gimbal), as recorded."""
    found = [row for sender, own in rows[name].items() if sender[0] == vehicle[0] for row in own]
    return sorted(found, key=lambda row: row[0])


def _stamps(rows: list[_Row]) -> Stamps:
    return Stamps(
        order=np.array([row[0] for row in rows], dtype=np.int64),
        record_s=np.array([row[1] for row in rows], dtype=np.float64),
        boot_s=np.array([row[2].boot_s for row in rows], dtype=np.float64),
    )


def _columns(rows: list[_Row], count: int) -> FloatArray:
    """Return the values of rows as columns ``(count, n)``."""
    values = np.array([row[2].values[:count] for row in rows], dtype=np.float64)
    columns: FloatArray = values.reshape(len(rows), count).T
    return columns


def _positions(message: str, rows: list[_Row]) -> Positions:
    lat_deg, lon_deg, height_m = _columns(rows, 3)
    if message == "GLOBAL_POSITION_INT":
        source = "relative_alt"
    else:
        # GPS_RAW_INT knows only mean sea level: take the first fix as the height of home.
        source, height_m = "gps_altitude_above_first_fix", height_m - height_m[0]
    return Positions(_stamps(rows), lat_deg, lon_deg, height_m, message, source)


def _camera_events(name: str, rows: list[_Row]) -> CameraEvents:
    unix_s, sequence = _columns(rows, 2)
    file_names = tuple(row[2].text for row in rows)
    return CameraEvents(_stamps(rows), unix_s, sequence.astype(np.int64), file_names, name)


def _gimbal(rows: _Rows, vehicle: _Vehicle) -> GimbalAttitudes | None:
    for name in _GIMBAL_MESSAGES:
        senders = [own for sender, own in rows[name].items() if sender[0] == vehicle[0]]
        if senders:
            found = max(senders, key=len)
            columns = _columns(found, 5)
            return GimbalAttitudes(_stamps(found), columns[:4].T, columns[4] > 0.5, name)
    return None


class TlogWriter(AbstractContextManager["TlogWriter"]):
    """Write a MAVLink 2 ``.tlog``, atomically: the file appears when the ``with`` block ends well.

    Raises:
        OutputError: the file cannot be written.
    """

    def __init__(self, path: Path, system: int = 1, component: int = 1) -> None:
        """Write as vehicle ``system`` and ``component`` (1 is the autopilot)."""
        self._path = path
        self._temporary = path.with_name(f".{path.name}.{os.getpid()}.tmp")
        self._sender = dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._handle: BinaryIO | None = None

    def __enter__(self) -> "TlogWriter":
        """Open the temporary file."""
        try:
            self._handle = self._temporary.open("wb")
        except OSError as error:
            raise self._failure(error) from error
        return self

    def write(self, time_utc_s: float, message_name: str, **fields: Any) -> None:
        """Append one record; ``fields`` are the message's own, in its own units.

        Raises:
            ValueError: the dialect has no such message.
        """
        if self._handle is None:
            raise ValueError("TlogWriter writes inside its with block only")
        make = getattr(dialect, f"MAVLink_{message_name.lower()}_message", None)
        if make is None:
            raise ValueError(f"no MAVLink message is called {message_name}")
        packet = make(**fields).pack(self._sender)
        self._sender.seq = (self._sender.seq + 1) % 256
        try:
            self._handle.write(round(time_utc_s * 1e6).to_bytes(TIME_BYTES, "big") + packet)
        except OSError as error:
            raise self._failure(error) from error

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Rename the file into place, or remove it if the block failed."""
        if self._handle is None:
            return
        try:
            self._handle.close()
            if kind is None:
                self._temporary.replace(self._path)
        except OSError as failure:
            raise self._failure(failure) from failure
        finally:
            self._handle = None
            self._temporary.unlink(missing_ok=True)

    def _failure(self, error: OSError) -> OutputError:
        return OutputError(f"cannot write {self._path}: {error.strerror or error}")
