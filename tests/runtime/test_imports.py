"""What runtime loads: planning needs numpy and onnxruntime alone, and nothing is loaded that is not used."""

from __future__ import annotations

import ast
import os
import subprocess
import sys
import textwrap
from pathlib import Path

ROOT = Path(__file__).parents[2]
RUNTIME_THIRD_PARTY = {"numpy", "onnxruntime"}
MORE_IN = {
    "runtime/cli": {"typer", "rich"},
    "runtime/arm/bullet": {"pybullet"},
    "runtime/arm/mujoco": {"mujoco"},
    "runtime/arm/film.py": {"imageio_ffmpeg"},
    "runtime/arms": {"mujoco", "mcap_ros2"},
    "runtime/commands/parquet.py": {"pyarrow"},
    "runtime/outputs/parquet_file.py": {"pyarrow"},
    "runtime/outputs/frame.py": {"pandas"},
    "runtime/outputs/plot.py": {"matplotlib"},
    "runtime/plan.py": {"pandas", "matplotlib"},  # names of types
    "runtime/many": {"pyarrow"},
    "runtime/many/workers.py": {"ray"},
    "runtime/client": {"websockets", "httpx"},
    "runtime/network/hub.py": {"huggingface_hub"},
    "runtime/physics/compiled.py": {"numba"},
}
"""What single modules or folders of runtime may import besides."""


def imported(module: Path) -> set[str]:
    """Return the top-level names a module imports, anywhere in it."""
    names = set()
    for node in ast.walk(ast.parse(module.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{module}: relative import"
            names.add((node.module or "").partition(".")[0])
    return names


def modules(package: str) -> list[Path]:
    return sorted((ROOT / package).rglob("*.py"))


def test_runtime_imports_the_standard_library_numpy_and_onnxruntime_only() -> None:
    found = modules("runtime")
    assert len(found) > 5
    for module in found:
        name = module.relative_to(ROOT).as_posix()
        allowed = RUNTIME_THIRD_PARTY | {"runtime"}
        for place, more in MORE_IN.items():
            if name == place or name.startswith(f"{place}/"):
                allowed = allowed | more
        wrong = imported(module) - allowed - sys.stdlib_module_names
        assert not wrong, f"{name} imports {', '.join(sorted(wrong))}"


def test_planning_works_without_the_packages_of_the_extras(bundle_path: Path, tmp_path: Path) -> None:
    program = f"""
        import importlib.abc, sys

        class Blocker(importlib.abc.MetaPathFinder):
            blocked = {{"torch", "onnx", "scipy", "numba", "matplotlib", "pydantic", "pybullet", "mujoco"}}
            blocked |= {{"imageio_ffmpeg", "typer", "rich"}}

            def find_spec(self, name, path=None, target=None):
                if name.partition(".")[0] in self.blocked:
                    raise ImportError(name + " is blocked")

        sys.meta_path.insert(0, Blocker())
        from runtime import Command, Plan, Planner

        plan = Planner({str(bundle_path)!r}).plan(Command.load({str(ROOT / "examples/figure_eight.csv")!r}))
        plan.save({str(tmp_path / "plan.json")!r})
        print(len(Plan.load({str(tmp_path / "plan.json")!r})))
        command = Command.load({str(ROOT / "examples/figure_eight.csv")!r})
        better = Planner({str(bundle_path)!r}).plan(command, refine_iterations=2)
        print(better.quality.tracking_rmse <= plan.quality.tracking_rmse)
    """
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "1200\nTrue\n", "")


def test_planning_leaves_nothing_in_the_home_folder(bundle_path: Path, tmp_path: Path) -> None:
    program = f"import runtime; runtime.Planner({str(bundle_path)!r})"
    kept = {name: value for name, value in os.environ.items() if not name.startswith(("ORT_", "XDG_"))}
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=ROOT, env={**kept, "HOME": str(tmp_path)}, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stderr) == (0, "")
    assert not list(tmp_path.iterdir())


def test_the_arm_is_imported_without_a_simulator_until_it_is_used() -> None:
    paths = [path.relative_to(ROOT).with_suffix("") for path in modules("runtime/arm") if path.stem != "__init__"]
    names = [".".join(path.parts) for path in paths]
    assert {"runtime.arm.run", "runtime.arm.program", "runtime.arm.mujoco.engine"} <= set(names)
    program = "; ".join(
        [
            "import sys",
            *(f"import {name}" for name in names),
            "import runtime.cli.plan, runtime.cli.run, runtime.cli.info",
            "print([name for name in ('pybullet', 'mujoco', 'imageio_ffmpeg', 'rich') if name in sys.modules])",
        ]
    )
    done = subprocess.run([sys.executable, "-c", program], cwd=ROOT, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "[]\n", "")
