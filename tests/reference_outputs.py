"""What this version computes, as hashes: write them before a change that must change nothing, compare after it.

    .venv/bin/python -m tests.reference_outputs write FILE.json [--values FILE.npz] [--only WORD]
    .venv/bin/python -m tests.reference_outputs compare FILE.json [--values FILE.npz] [--only WORD]

`write` computes everything in `OUTPUTS` with fixed seeds and stores of every array its type, shape, hash, and a few
values spread over it. `compare` computes it again, prints a table, and ends with 1 if something differs: how far then
shows from those few values, or from all of them with the `--values` that were written beside. Equal to the last bit is
promised on one machine only; `fixtures/reference-outputs.json` says on which it was written.

How each is computed is in `reference_computations.py`.
"""

from __future__ import annotations

import argparse
import json
import platform
import re
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Final

import numpy as np

from tests import reference_computations as of
from tests.reference_arrays import Arrays, Json, compare, summarise

SCENES: Final = ("ball", "dark", "low-contrast", "person", "two-persons", "rally", "head")
METHODS: Final = ("auto", "paper")
FORMATS: Final = ("voc", "yolo", "yolo-pose", "coco", "tracknet", "cvat", "csv", "hdf5")


@dataclass(frozen=True, slots=True)
class Output:
    """One entry of the table."""

    compute: Callable[[of.Bench], Arrays]
    stored: bool = False
    """From stored files and by arithmetic that other machines do almost alike. The others simulate, learn or draw in
    3D: there a rounding error may grow to anything."""


OUTPUTS: dict[str, Output] = {
    **{f"simulate {scene}": Output(of.simulate("--scene", scene, "--speed", 6)) for scene in SCENES},
    "simulate real physics": Output(of.simulate("--physics", "real", "--speed", 7)),
    "simulate robot": Output(of.simulate("--robot", cameras="side")),
    "simulate frames": Output(of.simulate("--frames-hz", 20, "--scene", "person")),
    "simulate flicker": Output(of.simulate("--flicker", 0.1, "--sensor", "48x32", "--speed", 9, cameras="")),
    "demo": Output(of.demo_beginning),
    **{f"detect demo, {name}": Output(of.detect("demo", "left", name)) for name in METHODS},
    **{f"detect stored, {name}": Output(of.detect("robot", "left", name), stored=True) for name in METHODS},
    **{f"detect dark, {name}": Output(of.detect("dark", "right", name)) for name in METHODS},
    "detect stored, refined": Output(of.detect("robot", "left", "refined"), stored=True),
    "detect stored, tuned": Output(of.detect("robot", "right", "auto", "tuned"), stored=True),
    "detect stored, both paths": Output(of.both_paths, stored=True),
    "detect stored, stages": Output(of.stages, stored=True),
    "track demo": Output(of.track("demo", "auto")),
    "track stored": Output(of.track("robot", "auto")),  # tested in test_files_of_earlier_versions.py
    "track stored, refined": Output(of.track("robot", "refined"), stored=True),
    "predict paper": Output(of.predict("paper"), stored=True),
    "predict paper, real": Output(of.predict("paper", "--physics", "real"), stored=True),
    "predict filter": Output(of.predict("filter"), stored=True),
    "predict filter, paper": Output(of.predict("filter", "--physics", "paper"), stored=True),
    "predict filter, real": Output(of.predict("filter", "--physics", "real"), stored=True),
    "closed loop": Output(of.closed_loop),
    "live world": Output(of.live_world),
    "wire": Output(of.wire, stored=True),
    "train ddpg": Output(of.train("ddpg", 100)),
    "train landing-model": Output(of.train("landing-model", 100)),
    "train ppo": Output(of.train("ppo", 100)),
    **{f"evaluate {run}": Output(of.evaluate(run)) for run in ("ddpg", "ppo", "landing-model")},
    **{f"labels {form}": Output(of.export_labels(form), stored=True) for form in FORMATS},
    "labels agree": Output(of.measure_labels("agree", "--with", "Jörg Ö./2")),  # tested there, too
    "labels score": Output(of.measure_labels("score", "--method", "auto"), stored=True),
    "export csv": Output(of.export("csv"), stored=True),
    "export csv of live": Output(of.export("csv", source="live"), stored=True),
    "export dsec": Output(of.export("dsec"), stored=True),
    "export evt3": Output(of.export("evt3"), stored=True),
    "export png": Output(of.export("png", "--method", "auto")),
    **{f"info {name}": Output(of.describe(name), stored=True) for name in ("robot", "live")},
    **{f"physics {profile}": Output(of.physics(profile)) for profile in ("paper", "real")},
    "event pictures": Output(of.pictures, stored=True),
    "stage pictures": Output(of.stage_pictures, stored=True),
    "watch status": Output(of.watch_status),
}


def compute_outputs(only: str | None = None, tell: Callable[[str], None] = lambda line: None) -> dict[str, Arrays]:
    """Everything in the table, or what has a word in its name."""
    found = {}
    with tempfile.TemporaryDirectory(prefix="reference-") as folder:
        bench = of.Bench(Path(folder))
        for name, output in OUTPUTS.items():
            if only is None or only in name:
                started_s = time.perf_counter()
                found[name] = output.compute(bench)
                tell(f"{time.perf_counter() - started_s:6.2f} s  {name}")
    return found


def machine() -> Json:
    """Where and with what it was computed."""
    names = ("rallyscope", "numpy", "numba", "torch", "mujoco", "opencv-python-headless", "scikit-learn")
    cpu = re.search(r"model name\s*: (.*)", Path("/proc/cpuinfo").read_text()) if sys.platform == "linux" else None
    return {
        "processor": cpu[1] if cpu else platform.processor(),
        "python": platform.python_version(),
        **{name: version(name) for name in names},
    }


def write(path: Path, found: dict[str, Arrays]) -> None:
    """Store what is kept of every output, a line each."""
    lines = [f'"machine": {json.dumps(machine())}, "outputs": {{']
    for name, arrays in found.items():
        kept = {key: summarise(array) for key, array in arrays.items()}
        lines.append(f"{json.dumps(name)}: {json.dumps(kept)},")
    path.write_text("{" + "\n".join(lines).removesuffix(",") + "\n}}\n", encoding="utf-8")


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="Hashes of what this version computes.")
    parser.add_argument("act", choices=("write", "compare"))
    parser.add_argument("file", type=Path, metavar="FILE.json")
    parser.add_argument("--values", type=Path, metavar="FILE.npz", help="all values, to see how far they differ")
    parser.add_argument("--only", metavar="WORD", help="outputs with this word in their name")
    arguments = parser.parse_args()
    found = compute_outputs(arguments.only, lambda line: print(line, file=sys.stderr))
    if arguments.act == "write":
        write(arguments.file, found)
        if arguments.values is not None:
            flat = {f"{name}|{key}": array for name, arrays in found.items() for key, array in arrays.items()}
            np.savez_compressed(arguments.values, **flat)  # type: ignore[arg-type]
        return 0
    stored = json.loads(arguments.file.read_text(encoding="utf-8"))
    values = {} if arguments.values is None else np.load(arguments.values)
    if stored["machine"] != machine():
        print(f"written elsewhere: {stored['machine']}\nhere:              {machine()}")
    rows = compare(stored["outputs"], found, values)
    width = max((len(name) for name, _ in rows), default=0)
    for name, words in rows:
        print(f"{name:{width}}  " + words.replace("\n", "\n" + " " * (width + 2)))
    different = [name for name, words in rows if words != "equal"]
    print(f"{len(rows) - len(different)} of {len(rows)} equal")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
