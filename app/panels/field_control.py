"""A control for a field of a config, made from its type, bounds, choices and documentation."""

from __future__ import annotations

import math

import viser

from app.formatting import field_words
from core.config import FieldSpec

TITLES = {
    "roi": "ROI",
    "ddpg": "DDPG",
    "rival": "Stable-Baselines3",
    "landing_model": "Landing model",
    "ebpp": "EBPP",
    "fe_fusion": "F-E Fusion",
}


def section_title(path: tuple[str, ...]) -> str:
    """The heading of a section of a config; that of the config itself is "Run"."""
    return TITLES.get(path[-1], path[-1].replace("_", " ").capitalize()) if path else "Run"


def field_label(spec: FieldSpec) -> str:
    """A field's name with its unit suffix set apart: `eps_px` -> "eps [px]"."""
    return field_words(spec.path[-2] if spec.path[-1] == "kind" else spec.path[-1])


def add_field_control(gui: viser.GuiApi, spec: FieldSpec, *, slider: bool = False) -> viser.GuiInputHandle:
    """A checkbox, a list of choices, a text for a list, or a number or slider within the bounds."""
    label, hint, default = field_label(spec), spec.doc, spec.default
    if spec.is_list:
        return gui.add_text(label, "", hint=hint)
    if spec.kind is bool:
        return gui.add_checkbox(label, bool(default), hint=hint)
    if spec.choices:
        return gui.add_dropdown(label, spec.choices, initial_value=str(default), hint=hint)
    assert spec.bounds is not None, f"{spec.path} has no bounds"
    assert isinstance(default, (int, float))
    low, high, step = (spec.kind(bound) for bound in (spec.bounds.low, spec.bounds.high, spec.bounds.step))
    if slider:
        return gui.add_slider(label, low, high, step, spec.kind(default), hint=hint)
    if spec.kind is float and default:
        step = min(step, 10.0 ** math.floor(math.log10(abs(default)) - 1))  # a small default is not to be rounded away
    return gui.add_number(label, spec.kind(default), min=low, max=high, step=step, hint=hint)
