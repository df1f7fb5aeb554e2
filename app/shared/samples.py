"""Sample recordings: simulated ones that come with the app, and public files that a person has fetched.

The app fetches nothing. `docs/use/samples.md` says where each public file comes from.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from importlib import resources
from pathlib import Path
from typing import Final

from app.shared.workspace import Workspace

DEMO: Final = "demo"
"""Name of the recording that the first start makes."""
SIMULATED: Final = "simulated sample"
PUBLIC: Final = "public sample"
"""What the folders are called in the list of files."""
PUBLIC_FILES: Final[Mapping[str, tuple[str, ...]]] = {
    "walker": ("walker_evt3_640x480.raw", "test_events_1.bag", "test_events_ros1_1.bag", "test_events_2_0.mcap"),
    "head": ("data_sample.aedat4", "head_320x240.aedat4"),
    "rotating dot": ("evt2_sample.raw", "rotating_dot_evt2_640x480.raw"),
    "planet": ("gen4.dat", "planet_gen4_1280x720.dat"),
}
"""Public recording -> the names under which its file is found: that of its source, or that of the tests' data."""
PAGE: Final = "docs/use/samples.md"


def sample_folders(workspace: Workspace) -> tuple[tuple[Path, str], ...]:
    """The folders of samples, and what each is called: that of the package, and that of the workspace."""
    own = resources.files("app") / "samples"
    simulated = ((own, SIMULATED),) if isinstance(own, Path) else ()  # a package in a ZIP has no files to open
    return (*simulated, (workspace.samples, PUBLIC))


def missing_samples(offered: Collection[str]) -> tuple[str, ...]:
    """The public recordings of which no file is among the offered file names."""
    return tuple(name for name, files in PUBLIC_FILES.items() if not any(file in offered for file in files))
