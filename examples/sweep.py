"""A sweep: many short trainings of a small network, each with other settings, chosen by Optuna from those before.

    pip install -c constraints.txt './[train,sweep]'
    python examples/sweep.py [--trials 10] [--folder out/sweep]

The folder then has each trial's run, the study, which the same command goes on with, and the table as Markdown. For a
sweep of your own, change BASE, COMMON, TRIED and `settings`: they may name any key of a configuration.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

import optuna
from optuna.storages import JournalStorage
from optuna.storages.journal import JournalFileBackend
from optuna.trial import FrozenTrial, Trial, TrialState

from train.config import AnyConfig, load_config
from train.learn.trainer import Progress, Trainer

BASE = "smoke"
"""The configuration that trials begin with."""

COMMON: dict[str, Any] = {
    "epochs": 6,
    "trajectories": 768,
    "batch": 32,
    "warm_up": 10,
    "disturbed_from": 1.0,
    "asked_from": 1.0,
    "static": (0.05, 0.3),
    "level": 1.0,
    "usual_reach": 1.0,
    "acceleration": (25.0, 35.0),
    "strength": (25.0, 35.0),
    "most": 1.0,
    "far_share": 0.0,
}
"""What all trials have in common: ten seconds of training, on slippery pans that stay level."""

TRIED = ("units", "learning_rate", "gamma", "average")
"""Keys of the configuration that the trials differ in."""

MM = 1e3
"""Millimetres in a metre."""


def settings(trial: Trial) -> dict[str, Any]:
    """Return what a trial changes of the configuration."""
    return {
        "units": trial.suggest_categorical("units", [16, 32, 64]),
        "learning_rate": trial.suggest_float("learning_rate", 1e-3, 3e-2, log=True),
        "gamma": trial.suggest_float("gamma", 0.05, 1.0, log=True),
        "average": trial.suggest_float("average", 0.8, 0.99),
    }


def train(config: AnyConfig, run: Path, at_epoch: Callable[[int, float], None]) -> float:
    """Train, and return the mean tracking error of the last epoch (m), whose trajectories are the same in each trial.

    Args:
        config: what to train.
        run: folder of the run.
        at_epoch: is told the number of an epoch and its mean error (m), and may end the run by raising.
    """
    trainer, errors = Trainer(config, run), list[float]()

    def report(progress: Progress) -> None:
        errors.append(progress.tracking)
        if len(errors) % trainer.steps_per_epoch == 0:
            at_epoch(progress.epoch, mean(errors[-trainer.steps_per_epoch :]))

    trainer.train(report)
    return mean(errors[-trainer.steps_per_epoch :])


def objective(folder: Path, common: Mapping[str, Any]) -> Callable[[Trial], float]:
    """Return what a trial does; one that is behind the others is given up."""

    def run(trial: Trial) -> float:
        def at_epoch(epoch: int, error: float) -> None:
            trial.report(error, epoch)
            if trial.should_prune():
                raise optuna.TrialPruned

        config = load_config(BASE, **{**common, **settings(trial)})
        return train(config, folder / f"trial-{trial.number}", at_epoch)

    return run


def sweep(folder: Path, trials: int, common: Mapping[str, Any] = COMMON) -> list[FrozenTrial]:
    """Run trials until there are so many, with those that the folder has already, and return all of them."""
    folder.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        storage=JournalStorage(JournalFileBackend(str(folder / "study.log"))),
        study_name=BASE,
        load_if_exists=True,
        pruner=optuna.pruners.MedianPruner(n_startup_trials=4, n_warmup_steps=1),
    )
    study.sampler = optuna.samplers.TPESampler(seed=len(study.trials))  # which goes on otherwise than it began
    ended = sum(trial.state.is_finished() for trial in study.trials)
    study.optimize(objective(folder, common), n_trials=max(0, trials - ended))
    return study.trials


def table(trials: Sequence[FrozenTrial]) -> str:
    """Return the trials as a table in Markdown, the best first."""
    ended = [trial for trial in trials if trial.state in (TrialState.COMPLETE, TrialState.PRUNED)]
    ended.sort(key=lambda trial: (trial.state != TrialState.COMPLETE, trial.value))
    lines = [f"| trial | {' | '.join(TRIED)} | epochs | error (mm) |", "|---" * (len(TRIED) + 3) + "|"]
    for trial in ended:
        chosen = " | ".join(f"{trial.params[name]:.3g}" for name in TRIED)
        epochs = "all" if trial.state == TrialState.COMPLETE else trial.last_step
        lines.append(f"| {trial.number} | {chosen} | {epochs} | {(trial.value or 0.0) * MM:.1f} |")
    return "\n".join(lines)


def main() -> None:
    """Run the trials that are missing, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=10, help="trials in all, with those that were run before")
    parser.add_argument("--folder", type=Path, default=Path("out/sweep"))
    given = parser.parse_args()
    text = table(sweep(given.folder, given.trials))
    (given.folder / "table.md").write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()
