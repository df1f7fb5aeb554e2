"""What this version computes: write it before a change that must change nothing, compare after it.

    .venv/bin/python -m tests.reference_outputs write FILE.npz [--only WORD]
    .venv/bin/python -m tests.reference_outputs compare FILE.npz [--only WORD]
    .venv/bin/python -m tests.reference_outputs write tests/fixtures/reference-outputs.npz --guarded

`write` computes everything in `OUTPUTS` with fixed seeds and stores every array. `compare` computes it again, prints a
table, and ends with 1 if something differs: equal to the last bit is promised on one machine only, so the table says
what is equal but for rounding. The tests compare what `guarded` marks with `fixtures/reference-outputs.npz`: the one
guard of computed answers.

How each is computed is in `reference_computations.py`.
"""

from __future__ import annotations

import argparse
import platform
import re
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Final

from tests import reference_computations as of
from tests.reference_arrays import EXACT, Arrays, Json, Tolerance, differences, read_outputs, write_outputs

SCENES: Final = ("ball", "dark", "low-contrast", "person", "two-persons", "rally", "head")
METHODS: Final = ("auto", "paper")
FORMATS: Final = ("voc", "yolo", "yolo-pose", "coco", "tracknet", "cvat", "csv", "hdf5")


@dataclass(frozen=True, slots=True)
class Output:
    """One entry of the table."""

    compute: Callable[[of.Bench], Arrays]
    guarded: Tolerance | None = None
    """What the tests allow; None for what simulates, learns or draws in 3D, where a rounding error may grow to
    anything: that is compared by hand, on one machine."""


ALIKE: Final = Tolerance()
PIXELS: Final = Tolerance(atol=1e-4, rtol=1e-6)
"""Tables of circles have four decimals; OpenCV releases round the float32 of a smallest circle otherwise (2e-5 px)."""
TRACK: Final = Tolerance(atol=1e-4, rtol=1e-6)
"""A tenth of a mm, of points that are fitted."""
PICTURE: Final = Tolerance(share=1e-3)
"""A line drawn through a point between two pixels lies in the one or the other."""
PLAYED: Final = Tolerance(atol=0.021, rtol=0.01)
"""One of fifty balls may fall on the other side of an edge."""

OUTPUTS: dict[str, Output] = {
    **{f"simulate {scene}": Output(of.simulate("--scene", scene, "--speed", 6)) for scene in SCENES},
    "simulate real physics": Output(of.simulate("--physics", "real", "--speed", 7)),
    "simulate robot": Output(of.simulate("--robot", cameras="side")),
    "simulate frames": Output(of.simulate("--frames-hz", 20, "--scene", "person")),
    "simulate flicker": Output(of.simulate("--flicker", 0.1, "--sensor", "48x32", "--speed", 9, cameras="")),
    "demo": Output(of.demo_beginning),
    **{f"detect demo, {name}": Output(of.detect("demo", "left", name)) for name in METHODS},
    **{f"detect stored, {name}": Output(of.detect("robot", "left", name), PIXELS) for name in METHODS},
    **{f"detect dark, {name}": Output(of.detect("dark", "right", name)) for name in METHODS},
    "detect stored, refined": Output(of.detect("robot", "left", "refined"), PIXELS),
    "detect stored, tuned": Output(of.detect("robot", "right", "auto", "tuned"), PIXELS),
    "detect stored, both paths": Output(of.both_paths, PIXELS),
    "detect stored, stages": Output(of.stages, ALIKE),
    "track demo": Output(of.track("demo", "auto")),
    "track stored": Output(of.track("robot", "auto"), TRACK),
    "track stored, refined": Output(of.track("robot", "refined"), TRACK),
    "predict paper": Output(of.predict("paper"), ALIKE),
    "predict paper, real": Output(of.predict("paper", "--physics", "real"), ALIKE),
    "predict filter": Output(of.predict("filter"), ALIKE),
    "predict filter, paper": Output(of.predict("filter", "--physics", "paper"), ALIKE),
    "predict filter, real": Output(of.predict("filter", "--physics", "real"), ALIKE),
    "closed loop": Output(of.closed_loop),
    "live world": Output(of.live_world),
    "wire": Output(of.wire, ALIKE),
    "train ddpg": Output(of.train("ddpg", 100)),
    "train landing-model": Output(of.train("landing-model", 100)),
    "train ppo": Output(of.train("ppo", 100)),
    **{f"evaluate {run}": Output(of.evaluate(run), PLAYED) for run in ("ddpg", "ppo", "landing-model")},
    **{f"labels {form}": Output(of.export_labels(form), ALIKE) for form in FORMATS},
    "labels agree": Output(of.measure_labels("agree", "--with", "Jörg Ö./2"), ALIKE),
    "labels score": Output(of.measure_labels("score", "--method", "auto"), ALIKE),
    "export csv": Output(of.digests(of.export("csv")), ALIKE),
    "export csv of live": Output(of.digests(of.export("csv", source="live")), ALIKE),
    "export dsec": Output(of.digests(of.export("dsec")), ALIKE),
    "export evt3": Output(of.digests(of.export("evt3")), ALIKE),
    "export png": Output(of.export("png", "--method", "auto")),
    **{f"info {name}": Output(of.describe(name), ALIKE) for name in ("robot", "live")},
    **{f"physics {profile}": Output(of.physics(profile)) for profile in ("paper", "real")},
    "event pictures": Output(of.pictures, PICTURE),
    "stage pictures": Output(of.stage_pictures, PICTURE),
    "watch status": Output(of.watch_status),
}


def compute_outputs(
    only: str | None = None, guarded: bool = False, tell: Callable[[str], None] = lambda name: None
) -> dict[str, Arrays]:
    """Everything in the table, or what has a word in its name, or what the tests compare."""
    found = {}
    with tempfile.TemporaryDirectory(prefix="reference-") as folder:
        bench = of.Bench(Path(folder))
        for name, output in OUTPUTS.items():
            if (only is None or only in name) and (output.guarded or not guarded):
                tell(name)
                found[name] = output.compute(bench)
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


def compare(stored: dict[str, Arrays], found: dict[str, Arrays]) -> list[tuple[str, str]]:
    """A row per output: its name, and "equal" or what differs in it."""
    rows = []
    for name, arrays in found.items():
        if name not in stored:
            rows.append((name, "not in the file"))
            continue
        exact = differences(stored[name], arrays, EXACT)
        rounded = not differences(stored[name], arrays, OUTPUTS[name].guarded or ALIKE)
        words = ["equal but for rounding", *exact] if exact and rounded else exact
        rows.append((name, "\n".join(words) or "equal"))
    return rows


def main() -> int:
    """The command line."""
    parser = argparse.ArgumentParser(description="What this version computes.")
    parser.add_argument("act", choices=("write", "compare"))
    parser.add_argument("file", type=Path, metavar="FILE.npz")
    parser.add_argument("--only", metavar="WORD", help="outputs with this word in their name")
    parser.add_argument("--guarded", action="store_true", help="only what the tests compare")
    arguments = parser.parse_args()
    found = compute_outputs(arguments.only, arguments.guarded, lambda name: print(name, file=sys.stderr))
    if arguments.act == "write":
        write_outputs(arguments.file, found, machine())
        return 0
    stored, elsewhere = read_outputs(arguments.file)
    if elsewhere != machine():
        print(f"written elsewhere: {elsewhere}\nhere:              {machine()}")
    rows = compare(stored, found)
    width = max((len(name) for name, _ in rows), default=0)
    for name, words in rows:
        print(f"{name:{width}}  " + words.replace("\n", "\n" + " " * (width + 2)))
    different = [name for name, words in rows if words != "equal"]
    print(f"{len(rows) - len(different)} of {len(rows)} equal")
    return 1 if different else 0


if __name__ == "__main__":
    sys.exit(main())
