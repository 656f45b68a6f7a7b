"""Readings of a log as columns that grow: a log of hours is not held as objects."""

from array import array
from collections.abc import Sequence

import numpy as np

from uasthn_cli.ingest.messages import Reading
from uasthn_cli.ingest.telemetry import Stamps
from uasthn_cli.types import FloatArray


class Records:
    """Readings of one message, in the order in which they were recorded."""

    def __init__(self) -> None:
        """Start empty."""
        self._order, self._width = array("q"), 0
        self._record_s, self._boot_s, self._values = array("d"), array("d"), array("d")
        self.texts: list[str] = []

    def __len__(self) -> int:
        """Return how many readings there are."""
        return len(self._order)

    def append(self, ordinal: int, record_s: float, reading: Reading) -> None:
        """Add the reading of record ``ordinal``; all have equally many values."""
        self._order.append(ordinal)
        self._record_s.append(record_s)
        self._boot_s.append(reading.boot_s)
        self._values.extend(reading.values)
        self._width = len(reading.values)
        self.texts.append(reading.text)

    @property
    def stamps(self) -> Stamps:
        """When they were recorded."""
        return Stamps(
            order=np.array(self._order, dtype=np.int64),
            record_s=np.array(self._record_s, dtype=np.float64),
            boot_s=np.array(self._boot_s, dtype=np.float64),
        )

    @property
    def columns(self) -> FloatArray:
        """Their values ``(k, n)``, each column in memory of its own."""
        values = np.array(self._values, dtype=np.float64).reshape(len(self), self._width)
        return np.ascontiguousarray(values.T)


def merged(parts: Sequence[Records]) -> Records:
    """Return the readings of several senders as one, in the order of the log."""
    if len(parts) == 1:
        return parts[0]
    whole = Records()
    entries = [
        (ordinal, record_s, Reading(boot_s, tuple(values), text))
        for part in parts
        for ordinal, record_s, boot_s, values, text in zip(
            part.stamps.order.tolist(),
            part.stamps.record_s.tolist(),
            part.stamps.boot_s.tolist(),
            part.columns.T.tolist(),
            part.texts,
            strict=True,
        )
    ]
    for entry in sorted(entries, key=lambda entry: entry[0]):
        whole.append(*entry)
    return whole
