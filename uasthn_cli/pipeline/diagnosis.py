"""Why hardly a frame of a flight fits: what else its frames fit under, by cheap trials."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from uasthn_cli.ingest.cameras import CameraSpec
from uasthn_cli.pipeline.trials import Assumption, Trials
from uasthn_cli.types import Fix, FrameResult

MOST_ACCEPTED = 0.2
"""Share of frames accepted below which a flight is worth a diagnosis."""

_LEAST_FRAMES = 6
_LEAST_NATS = 1.5
_LEAST_MARGIN_NATS = 1.0
"""Per frame, of 12 that follow each other. On `farms_bing` the truth has 4.0 and no other
assumption more than 0.3 (a turn, scale or clock next to the truth aside)."""

_TURNS_DEG = (*range(20, 360, 20), 90, 270)
_SCALES = tuple(2.0 ** (k / 6) for k in range(-6, 7) if k)
_CLOCKS_S = tuple(
    sign * s for s in (*range(8, 72, 8), 18, 37, 90, 120, 180, 3600) for sign in (1, -1)
)
_WORTH_A_TURN_NATS = 0.15
_FINER_TURNS_DEG = (10.0, 5.0)
_FINER_SCALES = (1.06, 1.03)
_FINER_CLOCKS_S = (4.0, 2.0, 1.0)


@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What trials say: ``fits`` is the assumption that is clearly the best, None where none is.

    ``nats`` per frame of ``fits``, of the flight as stated, and of the best rival of another kind;
    ``control_gain_nats`` is what the best has before the stated on other frames, None without any.
    """

    fits: Assumption | None
    stated_nats: float
    best: Assumption
    best_nats: float
    rival_nats: float
    control_gain_nats: float | None
    frames: int
    trials: dict[Assumption, float]

    def describe(self) -> dict[str, Any]:
        """Return the evidence, ready for ``run.json``."""
        return {
            "fits": None if self.fits is None else _described(self.fits),
            "nats_per_frame": {
                "stated": round(self.stated_nats, 3),
                "best": round(self.best_nats, 3),
                "runner_up": round(self.rival_nats, 3),
                "gain_on_other_frames": self.control_gain_nats and round(self.control_gain_nats, 3),
                "needed": _LEAST_NATS,
                "margin_needed": _LEAST_MARGIN_NATS,
            },
            "frames": self.frames,
            "trials": [
                {**_described(tried), "nats_per_frame": round(nats, 3)}
                for tried, nats in self.trials.items()
            ],
        }


def is_needed(results: Sequence[FrameResult]) -> bool:
    """Tell whether so few frames were accepted that something may be wrong throughout."""
    accepted = sum(isinstance(result, Fix) and result.accepted for result in results)
    return accepted < MOST_ACCEPTED * len(results)


def diagnose(trials: Trials, control: Trials | None = None) -> Diagnosis | None:
    """Try what people and logs get wrong; None where too few frames can be tried.

    What fits best must fit better than what is stated on other frames, those of ``control``, too.
    """
    if trials.frames < _LEAST_FRAMES:
        return None
    stated = Assumption()
    coarse = [
        *(Assumption(turn_deg=turn) for turn in _TURNS_DEG),
        *(Assumption(turn_deg=turn, mirrored=True) for turn in (0.0, 90.0, 180.0, 270.0)),
        *(Assumption(scale=scale) for scale in _SCALES),
        *(Assumption(added_s=float(added)) for added in _CLOCKS_S),
    ]
    best = _finer(trials, trials.best([stated, *coarse]))
    rivals = [a for a in trials.scores if not _are_near(a, best)]
    rival_nats = max(map(trials.score, rivals), default=0.0)
    nats, stated_nats = trials.score(best), trials.score(stated)
    is_clear = (
        best != stated
        and nats >= _LEAST_NATS
        and nats - stated_nats >= _LEAST_MARGIN_NATS
        and nats - rival_nats >= _LEAST_MARGIN_NATS
    )
    gain_nats = None
    if is_clear and control is not None:
        gain_nats = control.score(best) - control.score(stated)
        is_clear = gain_nats >= _LEAST_MARGIN_NATS
    fits = best if is_clear else None
    return Diagnosis(
        fits, stated_nats, best, nats, rival_nats, gain_nats, trials.frames, dict(trials.scores)
    )


def _finer(trials: Trials, best: Assumption) -> Assumption:
    """Return the best around an assumption, of its own kind."""
    if best.turn_deg or best.mirrored:
        for step_deg in _FINER_TURNS_DEG:
            turns = [(best.turn_deg + sign * step_deg) % 360 for sign in (-1, 1)]
            finer = trials.best([replace(best, turn_deg=turn) for turn in turns])
            # frames tell a few degrees hardly apart, and cameras are mounted at round angles
            if trials.score(finer) > trials.score(best) + _WORTH_A_TURN_NATS:
                best = finer
    elif best.scale != 1.0:
        for ratio in _FINER_SCALES:
            scales = best.scale / ratio, best.scale * ratio
            best = trials.best([best, *(replace(best, scale=scale) for scale in scales)])
    elif best.added_s:
        for step_s in _FINER_CLOCKS_S:
            clocks = best.added_s - step_s, best.added_s + step_s
            best = trials.best([best, *(replace(best, added_s=added) for added in clocks)])
    return best


def _are_near(a: Assumption, b: Assumption) -> bool:
    """Tell whether two assumptions are so alike that frames may fit under both."""
    turn_deg = abs((a.turn_deg - b.turn_deg + 180.0) % 360.0 - 180.0)
    is_alike = a.mirrored == b.mirrored and turn_deg <= 30.0
    is_scaled_alike = abs(math.log(a.scale / b.scale)) <= math.log(1.5)
    return is_alike and is_scaled_alike and abs(a.added_s - b.added_s) <= 20.0


def line_of(diagnosis: Diagnosis, camera: CameraSpec, time_offset_s: float) -> str:
    """Return what a person should hear, and the option that states it."""
    fits = diagnosis.fits
    if fits is None:
        return _unclear_line(diagnosis)
    turn_deg = fits.turn_deg if fits.turn_deg <= 180.0 else fits.turn_deg - 360.0
    if fits.mirrored:
        also = f" and turned by {turn_deg:g}°" if turn_deg else ""
        return (
            f"Frames fit when mirrored left to right{also}: write them unmirrored (mind the"
            " camera's image flip) and try again"
        )
    if turn_deg:
        mount_deg = (camera.mount_yaw_deg + turn_deg + 180.0) % 360.0 - 180.0
        mount_deg = 180.0 if mount_deg == -180.0 else mount_deg
        return f"Frames fit when turned by {turn_deg:g}°: try --mount-yaw {mount_deg:g}"
    if fits.added_s:
        return (
            f"Frames fit when {fits.added_s:g} s are added to their times: try --time-offset"
            f" {time_offset_s + fits.added_s:g}"
        )
    return f"Frames fit at {fits.scale:.2f} of the stated scale: {_scale_hint(fits.scale, camera)}"


def _unclear_line(diagnosis: Diagnosis) -> str:
    """Return what a person should hear where nothing fits better than all else."""
    if diagnosis.stated_nats >= _LEAST_NATS:
        return "Frames fit as stated, and nothing else clearly better: each one's detail says more"
    if diagnosis.best_nats >= _LEAST_NATS:
        return (
            "Frames fit under several assumptions or only some of them fit (run.json,"
            " notes.diagnosis): nothing is clear"
        )
    return (
        "Frames fit nowhere clearly, neither as stated nor turned, mirrored, scaled or at another"
        " time: is this the right map?"
    )


def _scale_hint(scale: float, camera: CameraSpec) -> str:
    if camera.hfov_deg is None:
        return "check the camera and the height above ground (--hfov, --height-m)"
    half = math.tan(math.radians(camera.hfov_deg) / 2.0) * scale
    return f"try --hfov {2.0 * math.degrees(math.atan(half)):.1f}, or check the height (--height-m)"


def _described(assumption: Assumption) -> dict[str, Any]:
    return {
        "turn_deg": assumption.turn_deg,
        "scale": round(assumption.scale, 4),
        "added_s": assumption.added_s,
        "mirrored": assumption.mirrored,
    }
