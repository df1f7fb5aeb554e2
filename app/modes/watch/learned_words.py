"""What the chain has learnt of air and table from the balls of the live rally, in words."""

from __future__ import annotations

from typing import Final

from core.trajectory.learned_constants import LearnedConstants

SURE: Final = 0.9


def learned_words(learned: LearnedConstants) -> str:
    """Drag, restitution and friction as text, each with its standard deviation."""
    if not learned.balls:
        return "as published; nothing is told, it learns from every ball"
    drag, restitution, friction = (
        f"{mean:.2f} ± {sigma:.2f}" for mean, sigma in zip(learned.means.tolist(), learned.sigmas.tolist(), strict=True)
    )
    if learned.air < 1 - SURE:
        air = "no air"
    elif learned.air > SURE:
        air = f"drag {drag}"
    else:
        air = f"air or none ({learned.air:.0%})"
    return f"{air}, restitution {restitution}, friction {friction} (learned from {balls_text(learned.balls)})"


def balls_text(count: int) -> str:
    """So many balls, in words."""
    return "1 ball" if count == 1 else f"{count} balls"
