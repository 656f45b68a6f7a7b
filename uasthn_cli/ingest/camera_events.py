"""When the exposures were that a log's camera messages tell of."""

import numpy as np

from uasthn_cli.ingest.clock import Clock
from uasthn_cli.ingest.telemetry import CameraEvents, Stamps
from uasthn_cli.types import FloatArray

_STALE_S = 10.0
"""A message whose own time is further than this from its arrival is dated by its arrival."""


def event_times_s(events: CameraEvents, clock: Clock) -> FloatArray:
    """Return UTC ``(n,)`` of exposures on a clock of the log.

    The vehicle's own stamp is used where it has one, freed of radio delay; else the record's.
    """
    boot_s = events.stamps.boot_s.copy()
    session = clock.session_of(events.stamps)
    arrival_s = np.full(len(boot_s), np.nan)
    for number, current in enumerate(clock.sessions):
        own = session == number
        from_unix_s = events.unix_s[own] - current.vehicle_offset_s
        boot_s[own] = np.where(np.isnan(boot_s[own]), from_unix_s, boot_s[own])
        arrival_s[own] = current.boot_s(events.stamps.record_s[own])
    stale = np.abs(boot_s - arrival_s) > _STALE_S
    boot_s[stale] = np.nan
    return clock.utc_s(Stamps(events.stamps.order, events.stamps.record_s, boot_s))
