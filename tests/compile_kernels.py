"""Run before the tests: compile what most of them need, once, while the static checks have the other processor.

Without it the workers of pytest, and every process that they start, would compile the same kernels of a fresh clone
side by side. What is compiled stands in the cache of this user (`core.jit`), where all of them find it.
"""

import sys
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

from app.cli.main import main as run_verb
from app.startup.chain import compile_chain


def verbs(folder: Path) -> Iterator[str]:
    """Command lines that together reach the kernels of files, simulation, detectors, flights and learning."""
    serve, rally = folder / "serve.h5", folder / "rally.h5"
    yield f"simulate --out {serve} --serves 1 --seed 7 --frames-hz 30 --sensor 320x180"
    yield f"simulate --out {rally} --serves 1 --seed 7 --scene two-persons --robot --sensor 320x180"
    for method in ("refined", "auto", "paper", "ebpp", "fe-fusion"):
        yield f"detect {serve} --camera left --method {method} --out {folder / method}.csv"
    yield f"detect {serve} --camera left --method auto --window-us 1000 --out {folder}/short.csv"
    yield f"track {serve} --out {folder}/track.csv"
    yield f"predict {folder}/track.csv --out {folder}/predicted.json"
    yield f"export {serve} --evt3 {folder}/evt3"
    yield f"import {folder}/evt3/left.raw {folder}/imported.h5"
    yield f"train --speeds 3 --episodes 40 --agent ddpg --out {folder}/run"
    yield f"train --speeds 3 --episodes 20 --agent landing-model --physics real --out {folder}/real"


def main() -> int:
    """Follow a painted ball, and run the verbs; 1 if one of them fails."""
    compile_chain(lambda ready, known: None)
    failed = 0
    with TemporaryDirectory() as folder:
        for line in verbs(Path(folder)):
            code = run_verb(line.split())
            if code:
                print(f"rallyscope {line}: exit code {code}", file=sys.stderr)
                failed = 1
    return failed


if __name__ == "__main__":
    sys.exit(main())
