"""Judging a plan: its figures, and the worst thing to be said of it."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from runtime.assess.sureness import friction_off_error
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.limits import LARGEST_SINK, UNITS, Limits
from runtime.physics.law import DT, GRAVITY, slide_one
from runtime.physics.motion import Motion, squares, tracking_error
from runtime.physics.positions import slide_to_rest
from runtime.quality import Changes, FrictionRange, OffPan, Quality, Status
from runtime.sizes import Sizes

FIGURES = {
    "pan_reach": "pan_reach",
    "height": "height_max",
    "speed": "speed_max",
    "acceleration": "acceleration_max",
    "jerk": "jerk_max",
}
"""The figure of `Quality` that each limit bounds."""

ROUNDING = 1e-6
"""Share of a limit by which a figure may pass it and nothing is said: the network's bounds are float32."""

CHANGED = 1e-3
"""Smallest change of an acceleration by the governor that counts (m/s^2): below it is float32's rounding."""

FEW = 0.05
"""Largest share of samples that the governor may change and the plan is called `governed`; beyond it is `limited`."""

STILL_SHARE = 0.5
"""Share of a still pan's tracking RMSE above which a plan is poor."""

STILL_FLOOR = 1e-3
"""Tracking RMSE (m) up to which no plan is poor for that: what remains of a command that hardly moves is stick-slip."""

POOR_RMSE = 0.01
"""Tracking RMSE (m) above which a plan is poor, if no tolerance was given."""

RIM_ROUNDING = 1e-9
"""Distance (m) by which an object may be over the rim and nothing is said: decimal fractions are not exact."""


def assess(
    motion: Motion,
    stop: FloatArray,
    command_position: FloatArray,
    friction: Friction,
    limits: Limits,
    sizes: Sizes,
    acceleration_before: FloatArray,
    tolerance: FrictionRange | None = None,
    beyond: Sequence[str] = (),
    remarks: Sequence[str] = (),
    friction_off_rmse: float | None = None,
) -> Quality:
    """Judge a plan.

    Args:
        motion: K samples of pan and object, as planned.
        stop: (n, 3) pan accelerations that follow and bring the pan to rest (m/s^2).
        command_position: (K, 2) where the object should be, relative to the pan's centre (m).
        friction: what it was planned for.
        limits: what the governor kept it to.
        sizes: of pan and object.
        acceleration_before: (3,) of the pan over the sample before the first (m/s^2).
        tolerance: under which friction the plan holds a tolerance, and which; None if there is no tolerance.
        beyond: a line for each thing that is outside the range trained on.
        remarks: further notes, which lead to no status.
        friction_off_rmse: what `friction_off_error` gives, if it is known already.
    """
    if friction_off_rmse is None:
        friction_off_rmse = friction_off_error(motion, command_position, friction)
    u, asked, pan, sliding = motion
    pan, sliding = pan[:-1], sliding[:-1]
    rmse, farthest = tracking_error(sliding[:, :2], command_position)
    largest = {
        "pan_reach": _largest(pan[:, :2]),
        "height": _largest(pan[:, 2:3]),
        "speed": _largest(pan[:, 3:]),
        "acceleration": _largest(u),
        "jerk": _largest(np.diff(u, axis=0, prepend=acceleration_before[None])),
    }
    figures = {FIGURES[name]: value for name, (value, _) in largest.items()}
    figures[FIGURES["jerk"]] /= DT
    held = limits.to_dict()
    changes = _count_changes(u, asked, limits)
    changed = _changed(changes, len(u))
    many = changes.samples > FEW * len(u)
    still = still_error(sliding[0], len(u), command_position, friction)
    rest = math.dist(slide_to_rest(motion.sliding[-1], stop, friction), command_position[-1])
    off_pan = {"command": find_off_pan(command_position, sizes), "object": find_off_pan(sliding[:, :2], sizes)}
    notes = {
        Status.LIMIT_EXCEEDED: _exceeded(figures, held) + _dropped(u, limits),
        Status.TOLERANCE_MISSED: _missed(rmse, tolerance),
        Status.OFF_PAN: _over_rim(off_pan, sizes),
        Status.CANNOT_SLIDE: cannot_slide(friction, limits) if still > 0.0 else [],
        Status.POOR: _poor(rmse, still, tolerance is None),
        Status.BEYOND_TRAINING_RANGE: beyond,
        Status.LIMITED: changed if many else [],
        Status.GOVERNED: [] if many else changed,
    }
    status = next((status for status, lines in notes.items() if lines), Status.OK)
    return Quality(
        tracking_rmse=rmse,
        tracking_max=farthest,
        **figures,
        sliding_share=float(np.mean((sliding[:, 2] != 0.0) | (sliding[:, 3] != 0.0))),
        limits=held,
        margins={name: None if limit is None else limit - figures[FIGURES[name]] for name, limit in held.items()},
        worst={name: sample for name, (_, sample) in largest.items()},
        governed=changes,
        friction=tolerance,
        friction_off_rmse=friction_off_rmse,
        rest_error=rest,
        command_off_pan=off_pan["command"],
        object_off_pan=off_pan["object"],
        status=status,
        notes=(*(line for lines in notes.values() for line in lines), *left_behind(rest), *remarks),
    )


def _largest(vectors: FloatArray) -> tuple[float, int]:
    """Return the largest length of vectors (n, d), and which has it."""
    each = squares(vectors)
    first = int(each.argmax())
    return math.sqrt(each[first]), first


def cannot_slide(friction: Friction, limits: Limits) -> list[str]:
    """Return a line if no pan within these limits breaks a resting object away, which is known before it is planned."""
    needed = friction.static * GRAVITY
    if limits.acceleration > needed:
        return []
    if not limits.level:
        # The pan sinks as it pushes, which the object feels as less weight: the best is to push along (1, -mu).
        sink = min(limits.acceleration * friction.static / math.hypot(1.0, friction.static), LARGEST_SINK)
        push, needed = math.sqrt(limits.acceleration**2 - sink**2), friction.static * (GRAVITY - sink)
        if push > needed:
            return []
        return [
            f"the object cannot slide: within {limits.acceleration:g} m/s^2 the pan may push by {push:.4g} m/s^2 while "
            f"it sinks, and static friction {friction.static:g} holds the object up to {needed:.4g} m/s^2 then"
        ]
    return [
        f"the object cannot slide: the pan may accelerate by {limits.acceleration:g} m/s^2, and static friction "
        f"{friction.static:g} holds the object up to {needed:.4g} m/s^2"
    ]


def _exceeded(figures: Mapping[str, float], limits: Mapping[str, float | None]) -> list[str]:
    lines = []
    for name, limit in limits.items():
        value, unit = figures[FIGURES[name]], UNITS[name]
        if limit is not None and value > limit * (1.0 + ROUNDING):
            lines.append(f"{name.replace('_', ' ')} {value:.4g} {unit} exceeds the limit of {limit:g} {unit}")
    return lines


def _dropped(u: FloatArray, limits: Limits) -> list[str]:
    """Return a line if the pan sinks from under the object."""
    sink = -float(u[:, 2].min())
    if not limits.finite or sink <= LARGEST_SINK * (1.0 + ROUNDING):
        return []
    return [
        f"the pan accelerates downwards by {sink:.4g} m/s^2, and the object keeps its hold up to {LARGEST_SINK:g} m/s^2"
    ]


def _missed(rmse: float, tolerance: FrictionRange | None) -> list[str]:
    if tolerance is None or rmse <= tolerance.tolerance:
        return []
    return [f"tracking RMSE {rmse:.4g} m exceeds the tolerance of {tolerance.tolerance:g} m"]


def find_off_pan(position: FloatArray, sizes: Sizes) -> OffPan | None:
    """Return where an object at (K, 2) positions relative to the pan's centre (m) is over the rim, None if nowhere."""
    farthest = squares(position)
    over = farthest > (sizes.room + RIM_ROUNDING) ** 2
    return OffPan(int(over.argmax()), math.sqrt(farthest.max()) - sizes.room) if over.any() else None


def _over_rim(off_pan: Mapping[str, OffPan | None], sizes: Sizes) -> list[str]:
    lines = []
    for name, found in off_pan.items():
        if found is not None:
            what = "the command leaves the pan" if name == "command" else "the object would leave the pan"
            hint = ". Is it relative to the pan's centre? If not: --origin first" if found.first == 0 else ""
            lines.append(
                f"{what} at sample {found.first} (t = {found.first * DT:.3f} s), by {found.farthest:.4g} m at most: an "
                f"object of radius {sizes.object_radius:g} m has {sizes.room:.4g} m to each side in a pan of radius "
                f"{sizes.pan_radius:g} m{hint}"
            )
    return lines


def still_error(start: FloatArray, samples: int, command_position: FloatArray, friction: Friction) -> float:
    """Return the tracking RMSE (m) on a pan that never moves, of an object that starts at (4,)."""
    position = start[None, :2]
    if start[2:].any():
        after = slide_one(start, np.zeros((samples - 1, 2)), friction)
        position = np.concatenate([start[None], after])[:, :2]
    return tracking_error(position, command_position)[0]


def _poor(rmse: float, still: float, without_tolerance: bool) -> list[str]:
    lines = []
    if rmse > STILL_SHARE * still and rmse > STILL_FLOOR:
        lines.append(
            f"tracking RMSE {rmse:.4g} m is more than half of the {still:.4g} m that a pan which never moves would have"
        )
    if without_tolerance and rmse > POOR_RMSE:
        lines.append(f"tracking RMSE {rmse:.4g} m is above {POOR_RMSE:g} m")
    return lines


def left_behind(rest: float | None) -> list[str]:
    """Return a line if the object rests far (m) from the command's end after the stop."""
    if rest is None or rest <= POOR_RMSE:
        return []
    return [
        f"after the stop the object rests {rest:.4g} m from the command's end: let the command rest there for its last "
        "0.2 s, and the object stays"
    ]


def _count_changes(u: FloatArray, asked: FloatArray, limits: Limits) -> Changes:
    if not limits.finite:
        return Changes(0, 0.0, 0.0)
    change = squares(u - asked)
    change = np.sqrt(change[change > CHANGED * CHANGED])
    return Changes(len(change), float(change.mean()), float(change.max())) if len(change) else Changes(0, 0.0, 0.0)


def _changed(changes: Changes, samples: int) -> list[str]:
    if not changes.samples:
        return []
    many = "1 sample" if changes.samples == 1 else f"{changes.samples} samples"
    return [
        f"the governor changed {many} ({changes.samples / samples:.1%}), by {changes.mean:.3g} m/s^2 on average, "
        f"{changes.largest:.3g} at most"
    ]
