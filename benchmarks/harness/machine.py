"""What a measurement was made on: the machine and the versions."""

from __future__ import annotations

import os
import platform
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

CPU_FLAGS = ("avx2", "fma", "avx512f", "avx512_vnni", "avx512_bf16", "amx_int8")
"""The instruction sets that decide how fast matrix products are."""

PACKAGES = ("numpy", "onnxruntime", "torch", "numba")

QUIET = 0.5
"""Load average per core up to which a machine counts as idle enough to be timed on."""


@dataclass(frozen=True)
class Machine:
    """A machine.

    Attributes:
        cpu: the processor's name.
        architecture: such as x86_64.
        system: operating system and its version.
        cores: cores this process may use.
        flags: those of CPU_FLAGS the processor has; empty where the system does not tell.
        load: load average over the last minute when the measurement began; None where the system does not tell.
    """

    cpu: str
    architecture: str
    system: str
    cores: int
    flags: tuple[str, ...]
    load: float | None

    @property
    def busy(self) -> bool:
        """Whether something else was running, so that timings say little."""
        return self.load is not None and self.load > QUIET * self.cores


def this_machine() -> Machine:
    """Return the machine this process runs on."""
    info = _cpu_info()
    flags = set(info.get("flags", info.get("Features", "")).split())
    return Machine(
        cpu=info.get("model name") or platform.processor() or "unknown",
        architecture=platform.machine(),
        system=f"{platform.system()} {platform.release()}",
        cores=len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1,
        flags=tuple(flag for flag in CPU_FLAGS if flag in flags),
        load=os.getloadavg()[0] if hasattr(os, "getloadavg") else None,
    )


def versions() -> dict[str, str | None]:
    """Return the versions of Python and of the packages that do the work; None for one that is not installed."""
    return {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _cpu_info() -> dict[str, str]:
    """Return what Linux tells of the first processor; nothing elsewhere."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").split("\n\n")[0].splitlines()
    except OSError:
        return {}
    pairs = (line.partition(":") for line in lines)
    return {name.strip(): value.strip() for name, _, value in pairs}
