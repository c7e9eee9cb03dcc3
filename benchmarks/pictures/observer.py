"""Draws how a stream sees an object: frames that come late, what is believed until then, and how a frame corrects it.

`python -m benchmarks.pictures.observer` renews docs/pictures/observer.svg.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.suite.families import spline
from benchmarks.suite.world import LawArm
from runtime.arm.eyes import Camera, Eyes
from runtime.arm.interface import PanCommand
from runtime.documents.checks import FloatArray
from runtime.friction import Friction
from runtime.outputs.picture import OBJECT, PAN, RIM
from runtime.physics.law import DT
from runtime.planner import Planner

PICTURE = Path(__file__).parents[2] / "docs" / "pictures" / "observer.svg"

EYES = Eyes(camera_rate=30.0, latency=0.05, noise=1e-3, seed=4)
PUSH_AT = 820
"""Sample at which the object is pushed, by 20 mm."""

SHOWN = (600, 1100)
"""Samples that are drawn."""


def record(planner: Planner) -> tuple[FloatArray, FloatArray, list[tuple[int, int, float]]]:
    """Follow a command, and return the object's true x, what is believed of it at each sample, (n,) each (m), and the
    frames: when each was taken and told (samples), and its x (m).
    """
    position = spline().positions[3]
    stream = planner.stream(position, noise=1e-3)
    arm, camera = LawArm(Friction(0.6, 0.45), {PUSH_AT: np.array([0.02, 0.0])}), Camera(EYES)
    measured = arm.reset(position[0])
    true, believed, frames = [], [], []
    for k in range(SHOWN[1]):
        executed = k % stream.chunk or stream.chunk
        for frame in camera.look(k, measured):
            stream.see_object(frame.position, (k - frame.taken) * DT, executed)
            frames.append((frame.taken, k, float(frame.position[0])))
        stream.see_pan(measured.pan, 0.0, executed)
        if k % stream.chunk == 0:
            u = stream.step()
        true.append(measured.sliding[0])
        believed.append(stream.object(k % stream.chunk).position[0])
        measured = arm.step(PanCommand(np.zeros(3), np.zeros(3), u[k % stream.chunk]))
    return np.array(true), np.array(believed), frames


def draw(path: Path = PICTURE) -> None:
    """Draw the picture."""
    from matplotlib import pyplot

    true, believed, frames = record(Planner())
    time = np.arange(len(true)) * DT
    part = slice(*SHOWN)
    figure, axes = pyplot.subplots(figsize=(9.0, 4.2), layout="constrained")
    axes.plot(time[part], true[part] * 1e3, color=RIM, linewidth=3.0, label="the object")
    axes.plot(time[part], believed[part] * 1e3, color=PAN, linewidth=1.2, label="what the stream believes at that time")
    shown = [frame for frame in frames if SHOWN[0] <= frame[0] and frame[1] < SHOWN[1]]
    for taken, told, x in shown:
        axes.plot([time[taken], time[told]], [x * 1e3] * 2, color=OBJECT, linewidth=0.8, alpha=0.7)
    axes.plot(
        [time[f[0]] for f in shown], [f[2] * 1e3 for f in shown], "o", color=OBJECT, markersize=4, label="frame, taken"
    )
    axes.plot(
        [time[f[1]] for f in shown], [f[2] * 1e3 for f in shown], ">", color=OBJECT, markersize=4, label="and told"
    )
    axes.axvline(PUSH_AT * DT, color="#201d1a", linewidth=0.8, dashes=(3, 3))
    axes.annotate("push of 20 mm", (PUSH_AT * DT, axes.get_ylim()[1]), (4, -12), textcoords="offset points")
    axes.set_xlabel("time (s)")
    axes.set_ylabel("x of the object on the pan (mm)")
    axes.legend(frameon=False, fontsize="small")
    axes.margins(x=0.0)
    figure.savefig(path, metadata={"Date": None})


if __name__ == "__main__":
    draw()
