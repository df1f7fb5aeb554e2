"""The `rallyscope` command: one file per verb."""

from app.cli.main import main

__all__ = ["main"]
