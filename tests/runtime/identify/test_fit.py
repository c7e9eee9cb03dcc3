"""Friction from logs: what it is, how sure, and what the law does not explain."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import Friction, InputError
from runtime.identify.fit import fit
from runtime.identify.log import Log, log_of
from runtime.identify.report import notes, write_report
from runtime.physics.law import GRAVITY, slide_one, slide_step

Array = NDArray[np.float64]


def shaken(samples: int = 1200, seed: int = 0, strength: float = 12.0) -> Array:
    rng = np.random.default_rng(seed)
    knots = rng.uniform(-strength, strength, (samples // 60 + 2, 2))
    at = np.arange(samples) / 60.0
    return np.stack([np.interp(at, np.arange(len(knots)), knots[:, axis]) for axis in (0, 1)], axis=1)


def seen(u: Array, states: Array, noise: float, late: int = 0, every: int = 10, seed: int = 0) -> Log:
    rng = np.random.default_rng(seed)
    position = np.full((len(u), 2), np.nan)
    at = np.arange(0, len(u), every)
    position[at] = states[np.maximum(at - late, 0), :2] + rng.normal(0.0, noise, (len(at), 2))
    return log_of(np.arange(len(u)) * 1e-3, u, position)


def slid(u: Array, friction: Friction) -> Array:
    return np.concatenate([np.zeros((1, 4)), slide_one(np.zeros(4), u, friction)])


@pytest.mark.parametrize("seed", range(3))
def test_friction_is_found_with_intervals(seed: int) -> None:
    true, u = Friction(0.6, 0.45), shaken(seed=seed)
    found = fit(seen(u, slid(u, true), 1e-3, seed=seed))
    assert found.friction.kinetic == pytest.approx(true.kinetic, rel=0.03)
    assert found.kinetic is not None
    assert found.kinetic[0] < true.kinetic < found.kinetic[1]
    assert found.static[0] < true.static < found.static[1]
    assert found.explained
    assert found.hints == ()
    assert found.noise == pytest.approx(1e-3, rel=0.4)
    assert found.residual == pytest.approx(1e-3, rel=0.25)
    assert notes(found) == []


@pytest.mark.parametrize("seed", [101, 117, 126])
def test_object_that_may_rest_or_creep_at_the_begin_leaves_its_static_friction_in_the_interval(seed: int) -> None:
    """Noise hides whether it rests: creeping, it would need no break-away, and no static friction would show."""
    true, u = Friction(0.6, 0.45), shaken(seed=seed)
    found = fit(seen(u, slid(u, true), 1e-3, seed=seed))
    assert found.static[0] <= true.static <= found.static[1]
    assert found.kinetic is not None
    assert found.kinetic[0] <= true.kinetic <= found.kinetic[1]


def test_frames_far_off_count_little() -> None:
    true, u = Friction(0.6, 0.45), shaken()
    log = seen(u, slid(u, true), 1e-3)
    log.position[[20, 57]] += 0.05
    found = fit(log)
    assert found.friction.kinetic == pytest.approx(true.kinetic, rel=0.05)
    assert found.outliers >= 2


def test_object_that_never_slides_tells_no_kinetic_friction_and_a_lower_bound() -> None:
    u = shaken(strength=4.0)
    found = fit(seen(u, slid(u, Friction(2.0, 1.5)), 1e-4))
    assert found.kinetic is None
    assert found.static[1] == 10.0
    assert "too little to find its friction" in notes(found)[0]


def test_viscous_friction_is_hinted_at() -> None:
    u, rows = shaken(seed=2), [(0.0, 0.0, 0.0, 0.0)]
    for ux, uy in u.tolist():
        px, py, vx, vy = rows[-1]
        rows.append(slide_step(px, py, vx, vy, ux + 6.0 * vx, uy + 6.0 * vy, 0.4 * GRAVITY, 0.2 * GRAVITY, 1e-3))
    found = fit(seen(u, np.array(rows), 2e-4))
    assert "viscous" in [hint.name for hint in found.hints]
    assert not found.explained
    assert "not to be trusted" in notes(found)[0]


def test_leaning_pan_is_hinted_at() -> None:
    u = shaken(seed=1)
    states = slid(u - [0.4, 0.0], Friction(0.6, 0.45))
    found = fit(seen(u, states, 2e-4))
    hint = next(hint for hint in found.hints if hint.name == "tilt_x")
    assert hint.value == pytest.approx(0.4, rel=0.4)


def test_late_time_stamps_are_hinted_at() -> None:
    u = shaken(seed=3)
    found = fit(seen(u, slid(u, Friction(0.6, 0.45)), 2e-4, late=20))
    hint = next(hint for hint in found.hints if hint.name == "late")
    assert 0.005 < hint.value < 0.03
    assert not found.explained


def test_noise_must_be_positive() -> None:
    u = shaken(400)
    with pytest.raises(InputError, match="noise must be greater than 0 m, got -1 m"):
        fit(seen(u, slid(u, Friction()), 1e-3), noise=-1.0)


def test_document_and_page_tell_the_same(tmp_path: Path) -> None:
    u = shaken(600)
    found = fit(seen(u, slid(u, Friction(0.6, 0.45)), 1e-3))
    document = json.loads(json.dumps(found.to_dict(), allow_nan=False))
    assert document["friction"] == found.friction.to_dict()
    page = tmp_path / "page.html"
    write_report(page, "log <1>", found)
    content = page.read_text(encoding="utf-8")
    assert f"{found.friction.kinetic:.3f}, from" in content
    assert "log &lt;1&gt;" in content
    assert content.count("<svg") == 3
