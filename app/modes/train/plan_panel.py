"""The form of a new training: presets, and every choice that a plan has."""

from __future__ import annotations

from collections.abc import Callable
from typing import get_args

import viser

from app.modes.train.form import ADVANCE, SEEN_AS, FormValues, plan_of_form
from app.modes.train.plan import (
    MOST_FIRST_SEED,
    MOST_SEEDS,
    PRESETS,
    TRAIN_NOW,
    Preset,
    TrainingPlan,
    numbers_text,
    offered_agents,
    offered_presets,
)
from app.widgets import when_changed, when_clicked
from core.learning.config import ReplayRule, RewardKind


class PlanPanel:
    """The controls of a plan in one browser; `start(name, plan)` and `choose(preset)` are called in the loop."""

    def __init__(
        self,
        gui: viser.GuiApi,
        start: Callable[[str, TrainingPlan], None],
        choose: Callable[[Preset], None],
        later: Callable[[Callable[[], None]], None],
    ) -> None:
        self._start = start
        self._choose = choose
        self._preset = gui.add_dropdown("Preset", offered_presets(), hint="Fills in everything below")
        self._agent = gui.add_dropdown("Agent", offered_agents(), hint="ddpg is the paper's")
        self._reward = gui.add_dropdown("Reward", get_args(RewardKind))
        self._replay = gui.add_dropdown("Keep of old balls", get_args(ReplayRule), hint="When a stage begins")
        self._speeds = gui.add_text("Speeds [m/s]", "", hint="A stage each, 3 to 9: 3, 5")
        self._episodes = gui.add_text("Balls a stage", "", hint="One number for all, or one for each: 800, 900")
        self._advance = gui.add_dropdown("A stage ends", tuple(ADVANCE))
        self._source = gui.add_dropdown("Ball is seen", tuple(SEEN_AS))
        self._seeds = gui.add_number("Seeds", 1, min=1, max=MOST_SEEDS, step=1, hint="Repetitions, one after another")
        self._first_seed = gui.add_number("First seed", 0, min=0, max=MOST_FIRST_SEED, step=1)
        self._name = gui.add_text("Name", "", hint="Of the run; empty: one is made")
        button = gui.add_button("Start", icon=viser.Icon.PLAYER_PLAY)
        when_changed(self._preset, lambda name: later(lambda: self._use(str(name))))
        when_clicked(button, lambda: later(self._send))
        self._fill(PRESETS[TRAIN_NOW])

    @property
    def preset(self) -> Preset:
        """The one that was chosen last."""
        return self._chosen

    def _use(self, name: str) -> None:
        if name in offered_presets():
            self._fill(PRESETS[name])
            self._choose(PRESETS[name])

    def _fill(self, preset: Preset) -> None:
        self._chosen, plan = preset, preset.plan
        self._agent.value, self._reward.value, self._replay.value = plan.agent, plan.reward, plan.replay
        self._speeds.value, self._episodes.value = numbers_text(plan.speeds_mps), numbers_text(plan.episodes)
        self._advance.value = next(shown for shown, value in ADVANCE.items() if value == plan.advance)
        self._source.value = next(shown for shown, value in SEEN_AS.items() if value == plan.source)
        self._seeds.value, self._first_seed.value = plan.seeds, plan.first_seed

    def _send(self) -> None:
        form = FormValues(
            agent=self._agent.value,
            reward=self._reward.value,
            replay=self._replay.value,
            speeds=self._speeds.value,
            episodes=self._episodes.value,
            advance=self._advance.value,
            source=self._source.value,
            seeds=self._seeds.value,
            first_seed=self._first_seed.value,
        )
        self._start(str(self._name.value), plan_of_form(form))
