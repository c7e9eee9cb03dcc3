"""Commands in step: by numba the same plans as by the plain loop, whatever is planned together."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from runtime import BundleError, Friction, Limits, Planner, Start, compile_law
from runtime.command import Command
from runtime.network.bundle import Bundle, LstmState
from runtime.network.decode import decode_all
from runtime.network.job import Job

MakeCurve = Callable[..., NDArray[np.float64]]

LIMITS = [
    Limits(),
    Limits(height=0.1),
    Limits.named("panda"),
    Limits(0.06, acceleration=20.0, jerk=3_000.0),
    Limits(0.02, acceleration=40.0, jerk=20_000.0, height=0.01),
]


@pytest.fixture
def compiled() -> Iterator[Callable[[], None]]:
    pytest.importorskip("numba")
    yield lambda: pytest.fail("numba is not used") if not compile_law() else None
    compile_law(False)


def test_commands_in_step_are_planned_as_by_the_plain_loop_to_the_last_bit(
    planner: Planner, make_curve: MakeCurve, compiled: Callable[[], None]
):
    lengths = [2, 57, 58, 59, 300, 300, 1190, 1200, 4000]
    jobs = [
        Job(
            Command((0.2 + 0.2 * (n % 4)) * make_curve(samples, n)),
            Friction(0.3 + 0.1 * (n % 3), 0.2),
            LIMITS[n % len(LIMITS)],
            Start(pan_velocity=(0.05, 0.02)),
            reach_used=(1.0, 0.5, 0.25)[n % 3],
        )
        for n, samples in enumerate(lengths * 3)
    ]
    plain = decode_all(planner.bundle, jobs)
    assert any((motion.acceleration != motion.asked).any() for motion, _ in plain)
    compiled()
    together = decode_all(planner.bundle, jobs)
    alone = [decode_all(planner.bundle, [job])[0] for job in jobs]
    for (motion, pan), *others in zip(plain, together, alone, strict=True):
        for other, other_pan in others:
            assert other_pan == pan
            for one, another in zip(motion, other, strict=True):
                np.testing.assert_array_equal(one, another)


def test_a_batch_of_more_commands_than_are_asked_at_once_is_the_same(
    planner: Planner, make_curve: MakeCurve, compiled: Callable[[], None]
):
    positions = [0.5 * make_curve(200 + n % 3, n) for n in range(60)]
    plain = planner.plan_batch(positions, Friction(0.3, 0.2))
    compiled()
    for one, other in zip(plain, planner.plan_batch(positions, Friction(0.3, 0.2)), strict=True):
        np.testing.assert_array_equal(one.pan_acceleration, other.pan_acceleration)
        np.testing.assert_array_equal(one.stop_acceleration, other.stop_acceleration)
        assert one.quality.friction_off_rmse == pytest.approx(other.quality.friction_off_rmse, rel=1e-12)
        assert one.quality.status == other.quality.status


def test_a_network_that_gives_no_number_is_named(planner: Planner, make_curve: MakeCurve, compiled: Callable[[], None]):
    class Broken(Bundle):
        def decode_step(
            self, observation: NDArray[np.float32], state: LstmState
        ) -> tuple[NDArray[np.float32], LstmState]:
            answer, after = super().decode_step(observation, state)
            return answer * np.float32(np.nan), after

    found = planner.bundle
    broken = Broken(found.path, found.manifest, found.sha256, found.sizes, found.sessions)
    compiled()
    with pytest.raises(BundleError, match="gave no finite number at sample 0"):
        decode_all(broken, [Job(Command(make_curve(100)), Friction(), Limits(), Start())])
