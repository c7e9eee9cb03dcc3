"""The friction that explains a log best, how sure that is, and whether the law explains the log at all.

A batch fit by multiple shooting: the log is cut into pieces; each has a position and a velocity of its own at its
begin, from which the law runs along what the pan did; the two frictions are the same for all. Gauss and Newton's
method, damped and kept within box bounds, makes the distances to the frames small; a frame far off counts less (Huber).
Static friction shows in no derivative until the object breaks away, so its interval is found by trying.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from runtime.documents.checks import FloatArray
from runtime.errors import InputError
from runtime.friction import MAX_COEFFICIENT, Friction
from runtime.identify.log import Log
from runtime.identify.shooting import (
    LEAST,
    Law,
    Piece,
    cost_of,
    covariance_of,
    derivative,
    jacobian_of,
    residuals,
    run,
    solve,
    weights_of,
)
from runtime.observe.sliding import Belief, Frame
from runtime.physics.law import DT, GRAVITY, slide_one

PIECE = 0.6
"""Duration of a piece (s): shorter ones know their begin less, longer ones depend on it more."""

TRIED = 18
"""Static frictions that are tried for its interval."""

LIKELY = 25.0
"""What the squared distances, over the noise's square, may grow by inside a 95 % interval: far more than the 3.84 of a
smooth problem, since where the object breaks away the squares jump, and no fit finds the least of them for sure."""

WIDER = 1.5
"""Times that an interval by derivatives is too narrow for the same reason."""

LEAST_NOISE = 1e-5
"""Smallest noise that is assumed (m): rounding in a log."""

SLIDES = 0.02
"""Speed (m/s) above which the object slides for sure."""

SLOW = 0.08
"""Speed (m/s) up to which the object may as well rest at the begin of a piece."""

ENOUGH_SLIDING = 0.05
"""Share of the time that it must slide for its kinetic friction to show."""

CLEAR = 4.5
"""Standard deviations from zero at which a hint is given, if it also explains WORTH of the residual."""

WORTH = 0.05
"""Share of the squared residual that a hint must explain."""

MOST_NOISE = 1.4
"""Times the noise that the residual may be for the law to explain the log."""

REMAINING = 5e-4
"""Residual (m) that no law is blamed for: pan and camera are no better known."""


HINTS = {
    "viscous": (1e-2, "1/s", "friction grows with speed (viscous): a film of liquid, a soft foot"),
    "tilt_x": (1e-2, "m/s^2", "the pan leans towards x"),
    "tilt_y": (1e-2, "m/s^2", "the pan leans towards y"),
    "late": (1e-3, "s", "the frames are late: their time stamps are of their arrival, or the pan's are early"),
}
"""What may bend the law: by how much it is tried, its unit, what it means."""


@dataclass(frozen=True)
class Hint:
    """Something besides Coulomb's law that explains a part of the residual.

    Attributes:
        name: of the term: viscous, tilt_x, tilt_y or late.
        value: of it, with its standard deviation `spread`, in `unit`.
        explains: share of the squared residual that it explains.
        meaning: in words.
    """

    name: str
    value: float
    spread: float
    unit: str
    explains: float
    meaning: str


@dataclass(frozen=True, eq=False)
class Fit:
    """What a log tells of the friction.

    Attributes:
        friction: that explains the log best.
        kinetic: 95 % interval of the kinetic one; None if the object hardly ever slides.
        static: 95 % interval of the static one; to MAX_COEFFICIENT if the object never breaks away.
        covariance: (2, 2) of kinetic and static friction, by the derivatives at the best.
        residual: root mean square of the distances between frames and law, per coordinate (m).
        noise: of the frames, found from how rough they are (m).
        explained: whether the law explains the log: what is left is noise.
        sliding_share: share of the time that the object slides.
        hints: what else explains a part of what is left.
        frames: number of frames, and `outliers` those that are far off.
        time, seen, law: (m,), (m, 2), (m, 2) the frames, and where the law says the object was (s, m).
    """

    friction: Friction
    kinetic: tuple[float, float] | None
    static: tuple[float, float]
    covariance: FloatArray
    residual: float
    noise: float
    explained: bool
    sliding_share: float
    hints: tuple[Hint, ...]
    frames: int
    outliers: int
    time: FloatArray
    seen: FloatArray
    law: FloatArray

    def to_dict(self) -> dict[str, Any]:
        """Return the figures as a JSON document, SI units throughout."""
        return {
            "friction": self.friction.to_dict(),
            "kinetic_interval": None if self.kinetic is None else list(self.kinetic),
            "static_interval": list(self.static),
            "covariance": self.covariance.tolist(),
            "residual": self.residual,
            "noise": self.noise,
            "explained": self.explained,
            "sliding_share": self.sliding_share,
            "hints": [asdict(hint) for hint in self.hints],
            "frames": self.frames,
            "outliers": self.outliers,
        }


def fit(log: Log, noise: float | None = None) -> Fit:
    """Fit the friction.

    Args:
        log: what was recorded.
        noise: standard deviation of a frame's position (m); found in the log if None.

    Raises:
        InputError: the noise is not greater than zero.
    """
    if noise is not None and not noise > 0.0:
        raise InputError(f"noise must be greater than 0 m, got {noise:g} m")
    sigma = max(_noise(log) if noise is None else noise, LEAST_NOISE)
    pieces = _pieces(log)
    law, begins = _first_guess(log, pieces, sigma)
    law, begins = solve(pieces, law, begins, sigma)
    law, begins, static, kinetic_between = _intervals(pieces, law, begins, sigma)

    left = np.concatenate(residuals(pieces, law, begins))
    weights = weights_of(left, sigma)
    counted = float(np.sqrt((weights[:, None] * left * left).sum() / (2.0 * weights.sum())))
    scale = max(sigma, counted)
    covariance = covariance_of(pieces, law, begins, weights) * scale * scale
    speeds = [np.hypot(*slide_one(b, p.u, law.friction)[:, 2:].T) for p, b in zip(pieces, begins, strict=True)]
    sliding = float(np.mean(np.concatenate(speeds) > SLIDES))
    spread = 2.0 * WIDER * math.sqrt(max(covariance[0, 0], 0.0))
    low, high = kinetic_between
    kinetic = (max(0.0, low - spread), high + spread) if sliding > ENOUGH_SLIDING else None
    predicted = np.concatenate([piece.position for piece in pieces]) - left
    return Fit(
        friction=law.friction,
        kinetic=kinetic,
        static=static,
        covariance=covariance,
        residual=counted,
        noise=sigma,
        explained=counted <= max(MOST_NOISE * sigma, REMAINING),
        sliding_share=sliding,
        hints=_hints(pieces, law, begins, weights, left),
        frames=len(left),
        outliers=int((weights < 1.0).sum()),
        time=log.time[: len(left)],
        seen=predicted + left,
        law=predicted,
    )


def _noise(log: Log) -> float:
    """Return the noise of the frames: the part of third differences that no motion of a pan makes."""
    steady = np.abs(np.diff(log.time) - np.median(np.diff(log.time))) < 0.5 * np.median(np.diff(log.time))
    third = np.diff(log.position, n=3, axis=0)[steady[:-2] & steady[1:-1] & steady[2:]]
    return float(np.median(np.abs(third))) / 0.6745 / math.sqrt(20.0) if len(third) else LEAST_NOISE


def _pieces(log: Log) -> list[Piece]:
    samples = len(log.acceleration)
    count = max(1, round(samples * DT / PIECE))
    borders = np.linspace(0, samples, count + 1).round().astype(int)
    pieces = []
    for first, last in pairwise(borders.tolist()):
        final = last == samples
        inside = (log.time >= first * DT - 1e-9) & ((log.time < last * DT - 1e-9) | final)
        time = np.clip(log.time[inside] - first * DT, 0.0, (last - first) * DT)
        pieces.append(Piece(log.acceleration[first:last], time, log.position[inside]))
    return pieces


def _first_guess(log: Log, pieces: list[Piece], sigma: float) -> tuple[Law, list[FloatArray]]:
    """Return what the observer makes of the log, which needs no guess."""
    belief = Belief.begin(0, np.array([*log.position[0], 0.0, 0.0]), Friction())
    states = {0: belief.state}
    for time, position in zip(log.time, log.position, strict=True):
        at = min(round(time / DT), len(log.acceleration))
        if at > belief.frame.at:
            belief = belief.see(Frame(at, position), log.acceleration[belief.frame.at : at], max(sigma, 1e-4))
            states[at] = belief.state
    begins, first, known = [], 0, np.array(sorted(states))
    for piece in pieces:
        at = int(known[max(int(np.searchsorted(known, first, side="right")) - 1, 0)])
        moved = slide_one(states[at], log.acceleration[at:first], belief.friction)
        begins.append(moved[-1] if len(moved) else states[at])
        first += len(piece.u)
    return Law(belief.friction.kinetic, belief.friction.static), begins


def _intervals(
    pieces: list[Piece], law: Law, begins: list[FloatArray], sigma: float
) -> tuple[Law, list[FloatArray], tuple[float, float], tuple[float, float]]:
    """Try static frictions, and return the best of all, with the interval of those that explain the log as well.

    The second interval is that of the kinetic friction which goes with each of them.
    """
    peak = max(float(np.hypot(piece.u[:, 0], piece.u[:, 1]).max()) for piece in pieces) / GRAVITY
    top = max(1.1 * peak, 1.2 * law.kinetic)
    tried = np.unique(np.concatenate([np.geomspace(max(law.kinetic, LEAST), top, TRIED), [law.static]]))
    outcomes, costs = [], np.empty(len(tried))
    for index, static in enumerate(tried.tolist()):
        held = law._replace(static=static)
        found = [solve(pieces, held, guess, sigma, hold_static=True, most=5) for guess in (begins, _resting(begins))]
        squares = [cost_of(np.concatenate(residuals(pieces, *each)), sigma) for each in found]
        outcomes.append(found[int(np.argmin(squares))])
        costs[index] = min(squares)
    best = int(costs.argmin())
    law, begins = solve(pieces, *outcomes[best], sigma, hold_static=True)
    scale = max(1.0, float(costs[best]) / max(1.0, 2.0 * sum(len(piece.time) for piece in pieces)))
    likely = costs <= costs[best] + LIKELY * scale
    first, last = int(likely.argmax()), len(tried) - 1 - int(likely[::-1].argmax())
    low = float(tried[first - 1]) if first > 0 else 0.0
    high = float(tried[last + 1]) if last < len(tried) - 1 else MAX_COEFFICIENT
    kinetic = [law.kinetic, *(outcome[0].kinetic for outcome, holds in zip(outcomes, likely, strict=True) if holds)]
    return law, begins, (max(low, 0.0), high), (min(kinetic), max(kinetic))


def _resting(begins: list[FloatArray]) -> list[FloatArray]:
    """Return begins with those at rest that move slowly: no derivative leads from a slow object to one that sticks."""
    return [np.where(np.hypot(*begin[2:]) < SLOW, begin * [1.0, 1.0, 0.0, 0.0], begin) for begin in begins]


def _hints(
    pieces: list[Piece], law: Law, begins: list[FloatArray], weights: FloatArray, left: FloatArray
) -> tuple[Hint, ...]:
    """Return what else explains a part of what is left: each term's size by one step of the fit with it added."""
    root = np.sqrt(np.repeat(weights, 2))
    known = jacobian_of(pieces, law, begins) * root[:, None]
    rest = left.ravel() * root
    basis = np.linalg.svd(known, full_matrices=False)[0]
    total = float(rest @ rest)
    hints = []
    for name, (step, unit, meaning) in HINTS.items():

        def bent_by(size: float, name: str = name) -> FloatArray:
            bent = law._replace(**{name: size})
            return np.concatenate([run(p, bent, b).ravel() for p, b in zip(pieces, begins, strict=True)])

        column = np.asarray(derivative(bent_by, step) * root, dtype=np.float64)
        column -= basis @ (basis.T @ column)
        square = float(column @ column)
        if square <= 0.0 or total <= 0.0:
            continue
        value = float(column @ rest) / square
        explains = value * value * square / total
        spread = math.sqrt((1.0 - explains) * total / max(1, len(rest) - known.shape[1] - 1) / square)
        if abs(value) > CLEAR * spread and explains > WORTH:
            hints.append(Hint(name, value, spread, unit, explains, meaning))
    return tuple(sorted(hints, key=lambda hint: -hint.explains))
