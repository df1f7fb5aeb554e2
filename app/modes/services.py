"""What all browsers of the app share, as one value that the app owns and lends to every session and mode."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.metadata import version
from typing import Final

from app.background.jobs import SharedWork
from app.export.exporter import Exporter
from app.export.viewer_streamer import ViewerStreamer
from app.shared.files import OfferedFiles
from app.shared.job_backends import HERE_ONLY, JobBackends
from app.shared.library import Library
from app.shared.rallies import Rallies
from app.shared.samples import sample_folders
from app.shared.trainer import Trainer
from app.shared.training_records import MetricsStore
from app.shared.workspace import Workspace
from app.state.browser_memory import BrowserMemory
from app.views.camera_pictures import CameraPicturesRequest, render_camera_pictures
from core.history.missed_balls import MissedBall, MissedBallRequest, find_missed_ball
from labels.store_registry import LabelStoreRegistry

LABEL_TOOL: Final = f"rallyscope {version('rallyscope')} label mode"


@dataclass(frozen=True, slots=True, eq=False)
class Services:
    """Each may be used from any thread."""

    workspace: Workspace
    library: Library
    rallies: Rallies
    label_stores: LabelStoreRegistry
    """Its stores are closed by the last browser that leaves them, after what it still had to save."""
    exporter: Exporter
    viewer: ViewerStreamer
    trainer: Trainer
    metrics: MetricsStore
    """What the training runs have written, read once for all browsers."""
    browsers: BrowserMemory
    """The settings of each browser."""
    files: OfferedFiles
    """What can be opened beside the recordings."""
    places: JobBackends
    """Where trainings and searches can be done."""
    camera_pictures: SharedWork[CameraPicturesRequest, dict[str, bytes]]
    missed_balls: SharedWork[MissedBallRequest, MissedBall | None]
    """Browsers that watch the same ask for the same."""

    @classmethod
    def of(
        cls,
        workspace: Workspace,
        library: Library,
        viewer_address: str | None = None,
        places: JobBackends = HERE_ONLY,
    ) -> Services:
        """The services of a workspace; `viewer_address` is that of a Rerun viewer which may be streamed to."""
        label_stores = LabelStoreRegistry(workspace.labels, tool=LABEL_TOOL)
        return cls(
            workspace,
            library,
            Rallies(),
            label_stores,
            Exporter(workspace),
            ViewerStreamer(viewer_address),
            Trainer(workspace, places),
            MetricsStore(),
            BrowserMemory(workspace),
            OfferedFiles(workspace, library.folders, sample_folders(workspace)),
            places,
            SharedWork(render_camera_pictures, lambda request: request.key),
            SharedWork(find_missed_ball, lambda request: request.key),
        )

    def close(self) -> None:
        """End what belongs to the app. A training goes on: it has a process of its own."""
        self.exporter.close()
        self.viewer.close()
        self.rallies.close()
        self.library.close()
