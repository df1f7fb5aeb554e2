"""Files that are not recordings of the workspace yet: which can be opened, and how they become recordings."""

from app.shared.files.arriving import bring_in
from app.shared.files.incoming import incoming_folder
from app.shared.files.offered import OfferedFile, OfferedFiles

__all__ = ["OfferedFile", "OfferedFiles", "bring_in", "incoming_folder"]
