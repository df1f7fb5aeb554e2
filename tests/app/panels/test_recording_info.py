"""What the tab Health says of a recording: only what is wrong is red."""

from pathlib import Path

from app import theme
from app.panels.recording_info import gather_info, health_html
from app.shared.library import Library
from app.shared.workspace import Workspace
from core.recordings import ImportOrder, import_recording


def test_where_a_recording_came_from_is_no_fault(tmp_path: Path) -> None:
    workspace = Workspace(tmp_path)
    source = tmp_path / "clip.csv"
    rows = "\n".join(f"{10 * k},{k % 30},{k % 20},{k % 2}" for k in range(5000))
    source.write_text(f"t,x,y,p\n{rows}\n")
    import_recording(ImportOrder([source]), workspace.recording_path("clip"))
    library = Library(workspace)
    said = health_html(gather_info(library, "clip"))
    library.close()
    line = next(part for part in said.split("<div") if "Imported from" in part)
    assert theme.BAD not in line and theme.MUTED in line
