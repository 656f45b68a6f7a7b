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
from uasthn_cli.ingest.messages import READERS
from uasthn_cli.ingest.records import Records, merged
from uasthn_cli.ingest.telemetry import (
    ABOVE_FIRST_FIX,
    Attitudes,
    CameraEvents,
    GimbalAttitudes,
    HeightSamples,
    Positions,
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

NO_ALTITUDE: Final = "none"
"""Source of the altitude in a log that has none."""

_Vehicle = tuple[int, int]
_Rows = dict[str, dict[_Vehicle, Records]]


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

    rows: _Rows = defaultdict(lambda: defaultdict(Records))
    packets = 0
    for ordinal, packet, message in iterate_packets(data, frozenset(_NAME_OF), decode):
        packets += 1
        name = _NAME_OF[packet.message_id]
        reading = READERS[name](message)
        if reading is not None:
            records = rows[name][packet.system, packet.component]
            records.append(ordinal, record_time_s(data, packet), reading)
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
    return Telemetry(
        path=path,
        vehicle=vehicle,
        positions=_positions(message, senders[vehicle]),
        attitudes=Attitudes(attitudes.stamps, *attitudes.columns),
        system_times=_system_times(_of_system(rows, "SYSTEM_TIME", vehicle)),
        camera_events=tuple(
            _camera_events(name, found)
            for name in _CAMERA_MESSAGES
            if (found := _of_system(rows, name, vehicle))
        ),
        gimbal=_gimbal(rows, vehicle),
        heights=tuple(
            HeightSamples(found.stamps, found.columns[0], source, along_body_axis)
            for name, source, along_body_axis in _HEIGHT_MESSAGES
            if (found := _of_system(rows, name, vehicle))
        ),
    )


def _of_system(rows: _Rows, name: str, vehicle: _Vehicle) -> Records:
    """Return one message's records of all components of a vehicle (camera, gimbal)."""
    return merged([own for sender, own in rows[name].items() if sender[0] == vehicle[0]])


def _system_times(records: Records) -> SystemTimes:
    return SystemTimes(records.stamps, records.columns[0] if records else np.empty(0))


def _positions(message: str, records: Records) -> Positions:
    lat_deg, lon_deg, height_m, alt_amsl_m = records.columns
    altitude_source = f"{message}.alt"
    if not alt_amsl_m.any():  # a sender that does not know it leaves the field at 0
        alt_amsl_m, altitude_source = np.full_like(alt_amsl_m, np.nan), NO_ALTITUDE
    if message == "GLOBAL_POSITION_INT":
        source = "relative_alt"
    else:
        # GPS_RAW_INT knows only mean sea level: take the first fix as the height of home.
        source, height_m = ABOVE_FIRST_FIX, height_m - height_m[0]
    return Positions(
        records.stamps, lat_deg, lon_deg, height_m, alt_amsl_m, message, source, altitude_source
    )


def _camera_events(name: str, records: Records) -> CameraEvents:
    unix_s, sequence = records.columns
    return CameraEvents(
        records.stamps, unix_s, sequence.astype(np.int64), tuple(records.texts), name
    )


def _gimbal(rows: _Rows, vehicle: _Vehicle) -> GimbalAttitudes | None:
    for name in _GIMBAL_MESSAGES:
        senders = [own for sender, own in rows[name].items() if sender[0] == vehicle[0]]
        if senders:
            found = max(senders, key=len)
            columns = found.columns
            return GimbalAttitudes(found.stamps, columns[:4].T, columns[4] > 0.5, name)
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
