"""Damage trials of the text files: configs, calibrations, manifests."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Final

import numpy as np
import tomli_w
import yaml

from benchmarks.damage.kinds import DamageKind, copy_folder, damage_a_file
from benchmarks.damage.sample_recording import SENSOR
from benchmarks.damage.tree_damage import damage_tree
from core.cameras import Camera, load_calibration
from core.cameras.calibration.lens_file import save_lens
from core.cameras.calibration_file import save_calibration
from core.config import load_config, save_config
from core.data_sets import MANIFEST, read_manifest
from core.data_sets.card import make_card
from core.detection import DetectorConfig
from core.physics.config import PhysicsConfig
from core.text.json_text import parse_json
from core.text.toml_text import parse_toml

Configs: Final = {"detector.toml": DetectorConfig, "physics.toml": PhysicsConfig}
CAMCHAIN: Final = """\
cam0:
  camera_model: pinhole
  distortion_model: radtan
  intrinsics: [90.0, 90.0, 47.0, 35.0]
  distortion_coeffs: [0.1, 0.0, 0.0, 0.0]
  resolution: [96, 72]
cam1:
  T_cn_cnm1: [[1, 0, 0, 0.2], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
  camera_model: pinhole
  distortion_model: radtan
  intrinsics: [90.0, 90.0, 47.0, 35.0]
  distortion_coeffs: [0.1, 0.0, 0.0, 0.0]
  resolution: [96, 72]
"""


def damage_text(whole: Path, damaged: Path, rng: np.random.Generator) -> str:
    """Half by the meaning of one of the files, half by its bytes."""
    if rng.random() < 0.5:
        return damage_a_file(whole, damaged, rng)
    copy_folder(whole, damaged)
    files = sorted(path for path in damaged.rglob("*") if path.suffix in PARSERS)
    victim = files[int(rng.integers(len(files)))]
    parse, dump, has_none = PARSERS[victim.suffix]
    what, tree = damage_tree(parse(victim.read_text()), rng, allow_none=has_none)
    try:
        victim.write_text(dump(tree), encoding="utf-8")
    except (TypeError, ValueError, yaml.YAMLError):  # what the format cannot say, such as None or 10**400
        victim.write_text(dump({"ball": 1}), encoding="utf-8")
    return f"{victim.name}: {what}"


def _parse_yaml(text: str) -> object:
    head, _, rest = text.partition("---\n")
    return yaml.safe_load((rest if head.startswith("%YAML") else text).replace("!!opencv-matrix", ""))


def _parse_lines(text: str) -> object:
    return [parse_json(line) for line in text.splitlines()]


def _dump_lines(tree: object) -> str:
    rows = tree if isinstance(tree, list) else [tree]
    return "".join(json.dumps(row) + "\n" for row in rows)


def _dump_toml(tree: object) -> str:
    return tomli_w.dumps(tree if isinstance(tree, dict) else {"tree": tree})


PARSERS: Final[dict[str, tuple[Callable[[str], object], Callable[[object], str], bool]]] = {
    ".toml": (parse_toml, _dump_toml, False),
    ".json": (parse_json, json.dumps, True),
    ".jsonl": (_parse_lines, _dump_lines, True),
    ".yaml": (_parse_yaml, yaml.safe_dump, True),
}


def _make_configs(folder: Path) -> None:
    for name, kind in Configs.items():
        save_config(kind(), folder / name)


def _open_configs(folder: Path) -> tuple[str, ...]:
    for name, kind in Configs.items():
        load_config(kind, folder / name)
    return ()


def _make_calibrations(folder: Path) -> None:
    K = np.array([[90.0, 0, 47], [0, 90, 35], [0, 0, 1]])
    camera = Camera(SENSOR, K, np.array([0.1, 0, 0, 0, 0]), np.eye(4))
    save_calibration(folder / "rig.toml", {"left": camera, "right": camera})
    save_lens(folder / "lens.yaml", "left", camera)
    (folder / "camchain.yaml").write_text(CAMCHAIN)


def _open_calibrations(folder: Path) -> tuple[str, ...]:
    for path in sorted(folder.iterdir()):
        for camera in load_calibration(path).values():
            camera.undistort(camera.project(np.array([[0.1, 0.1, 2.0]])))
    return ()


def _make_manifest(folder: Path) -> None:
    (folder / MANIFEST).write_text(json.dumps(SAMPLE_MANIFEST))


def _open_manifest(folder: Path) -> tuple[str, ...]:
    make_card(read_manifest(folder))
    return ()


SAMPLE_MANIFEST: Final[dict[str, object]] = {
    "format": "rallyscope-data-set", "rallyscope": "0.1", "title": "A trial", "seed": 3, "planned": 1,
    "scenes": ["ball"], "placements": ["side"], "speeds_mps": [6.0],
    "total": {
        "recordings": 1, "seconds": 2.5, "bytes": 9, "events": 9, "centres_2d": 9, "points_3d": 9,
        "points_3d_seen_by_all": 9, "frames": 9, "frames_with_ball": 9, "episodes": 1, "returned": 1,
        "racket_poses": 9, "delayed_by_readout": 0, "dropped_by_readout": 0,
    },
    "recordings": [{
        "file": "ball-6mps-side-1.h5",
        "settings": {"scene": "ball", "placement": "side", "speeds_mps": [6.0], "robot": True, "seed": 3},
        "name": "ball-6mps-side-1", "uuid": "u", "duration_us": 2_500_000, "bytes": 9,
        "cameras": {"left": {
            "events": 9, "centres": 9, "frames": 9, "frames_with_ball": 9, "delayed": 0, "dropped": 0,
        }},
        "points_3d": 9, "points_3d_seen": 9, "episodes": 1, "returned": 1, "racket_poses": 9,
    }],
}  # fmt: skip

CONFIGS: Final = DamageKind(name="config", make=_make_configs, damage=damage_text, open=_open_configs)
CALIBRATIONS: Final = DamageKind(
    name="calibration", make=_make_calibrations, damage=damage_text, open=_open_calibrations
)
MANIFESTS: Final = DamageKind(name="manifest", make=_make_manifest, damage=damage_text, open=_open_manifest)
