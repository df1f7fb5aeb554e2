"""These tests need the extra `ros`, which is part of `dev`."""

from __future__ import annotations

from importlib.util import find_spec

collect_ignore_glob = [] if find_spec("rosbags") and find_spec("mcap") else ["test_*.py"]
