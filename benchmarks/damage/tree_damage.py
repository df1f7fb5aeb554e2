"""Damage that knows trees of named values: what TOML, JSON and YAML files become when they are read."""

from __future__ import annotations

import copy
from typing import Final

import numpy as np

VALUES: Final[tuple[object, ...]] = (
    -1, 0, 1, 2, 1.5, -1e300, 1e300, float("nan"), float("inf"), 2**63, -(2**63), 10**400, "", "ball", "nan", "1",
    "x" * 5000, "../..", "\x00", "é\n", True, False, [], {}, [[]], [1, "a"], {"a": 1}, [0.0] * 9, [float("nan")] * 3,
)  # fmt: skip


def damage_tree(tree: object, rng: np.random.Generator, *, allow_none: bool) -> tuple[str, object]:
    """A copy with one value or more removed, doubled, or of another kind; and what was done."""
    changed = copy.deepcopy(tree)
    done = [_damage_once(changed, rng, allow_none) for _ in range(1 if rng.random() < 0.8 else int(rng.integers(2, 5)))]
    return "; ".join(done), changed


def _damage_once(tree: object, rng: np.random.Generator, allow_none: bool) -> str:
    places = list(_places(tree))
    if not places:
        return "nothing"
    holder, key = places[int(rng.integers(len(places)))]
    match int(rng.integers(6)):
        case 0 | 1:
            del holder[key]
            return f"{key} removed"
        case 2 if isinstance(holder, dict):
            holder[f"{key}x"] = holder.pop(key)
            return f"{key} renamed"
        case 3 if isinstance(holder, list):
            holder.append(copy.deepcopy(holder[key]))
            return f"{key} doubled"
        case 4 if allow_none:
            holder[key] = None
            return f"{key} nothing"
        case _:
            value = VALUES[int(rng.integers(len(VALUES)))]
            holder[key] = copy.deepcopy(value)
            return f"{key} = {str(value)[:30]!r}"


def _places(tree: object) -> list[tuple]:
    """Every holder with every key or index in it, at any depth."""
    if isinstance(tree, dict):
        found: list[tuple] = [(tree, key) for key in tree]
        return found + [place for value in tree.values() for place in _places(value)]
    if isinstance(tree, list):
        found = [(tree, index) for index in range(len(tree))]
        return found + [place for value in tree for place in _places(value)]
    return []
