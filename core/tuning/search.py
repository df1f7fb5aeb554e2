"""The proposals of a search, from optuna's tree-structured Parzen estimator (Bergstra et al. 2011), batch by batch."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import optuna
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from scipy.stats import rankdata

from core.config import Setting, get_setting
from core.detection import DetectorConfig
from core.tuning.parameters import Parameter

NEIGHBOURS: Final = 16
"""Trials near the config to start from, before the estimator takes over: far from it most configs find nothing at all,
and the estimator learns nothing from them."""
CHANGED_SHARE: Final = 0.3
"""Share of the parameters that a neighbour changes."""
STEP_SIGMA: Final = 0.06
"""Standard deviation of a change, on the parameter's scale from 0 to 1."""
FOREST_FROM: Final = 24
"""Fewest trials for a forest (fANOVA, Hutter et al. 2014) to tell parameters apart."""

Values = dict[str, Setting]


class Search:
    """Proposes configs in batches; deterministic for a seed and given scores."""

    def __init__(self, parameters: Sequence[Parameter], start: DetectorConfig, seed: int) -> None:
        self._parameters = {parameter.name: parameter for parameter in parameters}
        self._distributions = {parameter.name: _distribution(parameter) for parameter in parameters}
        self._start, self._seed = start, seed
        optuna.logging.set_verbosity(optuna.logging.WARNING)
        with warnings.catch_warnings(action="ignore", category=optuna.exceptions.ExperimentalWarning):
            sampler = optuna.samplers.TPESampler(
                n_startup_trials=1 + NEIGHBOURS, multivariate=True, constant_liar=True, seed=seed
            )
        self._study = optuna.create_study(direction="maximize", sampler=sampler)
        self._asked: list[optuna.Trial] = []
        self._first = {parameter.name: _internal(parameter, start) for parameter in parameters}
        self._study.enqueue_trial(self._first)
        rng = np.random.default_rng(seed)
        for _ in range(NEIGHBOURS):
            self._study.enqueue_trial(_neighbour(self._parameters, self._first, rng))

    def ask(self, count: int) -> tuple[Values, ...]:
        """Next proposals; the very first is the start config."""
        self._asked = [self._study.ask(self._distributions) for _ in range(count)]
        return tuple(self._values(trial.params) for trial in self._asked)

    def tell(self, objectives: Sequence[float]) -> None:
        """Report the scores of the last proposals, in their order."""
        for trial, objective in zip(self._asked, objectives, strict=True):
            self._study.tell(trial, objective)
        self._asked = []

    def importance(self) -> dict[str, float]:
        """Share of each parameter in what made trials differ, the largest first; empty while nothing can be said.

        Of the ranks of the trials: the many that find nothing would else be all that counts.
        """
        trials = self._study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.COMPLETE,))
        ranks = {trial.number: float(rank) for trial, rank in zip(trials, _ranks(trials), strict=True)}
        if len(set(ranks.values())) < 2:
            return {}
        if len(trials) < FOREST_FROM:
            shares = _correlations(self._parameters, trials, list(ranks.values()))
        else:
            evaluator = optuna.importance.FanovaImportanceEvaluator(seed=self._seed)
            shares = optuna.importance.get_param_importances(
                self._study,
                evaluator=evaluator,
                params=list(self._parameters),
                target=lambda trial: ranks[trial.number],
            )
        ordered = sorted(shares, key=lambda name: -shares[name])
        return {name: float(shares[name]) for name in ordered}

    def _values(self, params: Mapping[str, Setting]) -> Values:
        """Settings of a proposal; unchanged parameters keep their start values exactly."""
        values: Values = {}
        for name, parameter in self._parameters.items():
            proposed = params[name]
            if proposed == self._first[name]:
                values[name] = get_setting(self._start, parameter.spec.path)
            else:
                values[name] = proposed if parameter.choices is not None else parameter.value_at(float(proposed))  # type: ignore[arg-type]
        return values


def _ranks(trials: Sequence[optuna.trial.FrozenTrial]) -> np.ndarray:
    return rankdata([trial.value for trial in trials])


def _correlations(
    parameters: Mapping[str, Parameter], trials: Sequence[optuna.trial.FrozenTrial], ranks: Sequence[float]
) -> dict[str, float]:
    """Shares by each parameter's rank correlation with the score; empty if there is none."""
    sizes = {}
    for name, parameter in parameters.items():
        params = [trial.params[name] for trial in trials]
        places = rankdata([parameter.choices.index(value) if parameter.choices else value for value in params])
        sizes[name] = abs(float(np.corrcoef(places, ranks)[0, 1])) if np.ptp(places) > 0 else 0.0
    total = sum(sizes.values())
    return {name: size / total for name, size in sizes.items()} if total > 0 else {}


def _distribution(parameter: Parameter) -> BaseDistribution:
    choices = parameter.choices
    return FloatDistribution(0.0, 1.0) if choices is None else CategoricalDistribution(choices)


def _internal(parameter: Parameter, config: DetectorConfig) -> Setting:
    """Value as the estimator sees it: for a number its place on the scale."""
    value = get_setting(config, parameter.spec.path)
    if parameter.choices is not None:
        return value
    assert isinstance(value, (int, float))
    return parameter.place_of(value)


def _neighbour(parameters: Mapping[str, Parameter], of: Mapping[str, Setting], rng: np.random.Generator) -> Values:
    """Neighbour of a config: some numbers changed slightly, some choices redrawn."""
    changed = rng.random(len(parameters)) < CHANGED_SHARE
    changed[rng.integers(len(parameters))] = True
    steps, draws = rng.normal(0.0, STEP_SIGMA, len(parameters)), rng.random(len(parameters))
    values: Values = dict(of)
    for (name, parameter), change, step, draw in zip(parameters.items(), changed, steps, draws, strict=True):
        place = values[name]
        if change and parameter.choices is not None:
            values[name] = parameter.choices[int(draw * len(parameter.choices))]
        elif change and isinstance(place, (int, float)):
            values[name] = float(np.clip(place + step, 0.0, 1.0))
    return values
