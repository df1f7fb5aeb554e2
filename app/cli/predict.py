"""`rallyscope predict`: from the first points of a flight to where it bounces and crosses the hitting plane."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from app.cli.arguments import flag, positional, setting_flag
from app.cli.constants import CONSTANTS_HELP, given_constants
from app.cli.files import check_folder, write_text
from app.cli.terminal import print_lines, say
from core.chain.config import HIT_RULES, HitRule, expected_physics, fitted_filter
from core.chain.control.controller import BuiltInController
from core.chain.control.hit_choice import HitCandidate, HitChoice
from core.chain.control.player import choose_from_rest
from core.errors import CommandError
from core.physics.config import PhysicsConfig, Profile, physics_profile
from core.physics.constants_file import FittedConstants
from core.physics.points_file import PointsFile, read_points_file
from core.text import counted
from core.trajectory import (
    FilterPredictor,
    HitPlane,
    PaperPredictor,
    PaperPredictorConfig,
    Prediction,
    TablePoint,
    filter_for,
    predictor_for,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictArguments:
    """Predict a flight from its first points: where it bounces and where it crosses the hitting plane."""

    points: Path = positional(
        "columns t_s,x_m,y_m,z_m (world), what `track` writes, or as tt3d writes it", "POINTS.csv"
    )
    observe_ms: float = flag("predict from the first MS milliseconds of the flight", "MS", 150.0)
    method: Literal["paper", "filter"] = flag(
        "filter: every point, drag, spin; paper: five points, gravity, one reflection", default="filter"
    )
    physics: Profile | None = flag(
        "physics of the flight: the paper's simulation, or measured on real flights "
        "(default: the filter finds out, the paper's method takes the paper's)"
    )
    constants: Path | None = flag(CONSTANTS_HELP, "FILE")
    hit_x: float = setting_flag(PaperPredictorConfig, "hit_x_m", "M")
    hit: HitRule = flag(
        "chosen: add where the simulated racket would best hit the ball, with the other places and why not there",
        "|".join(HIT_RULES),
        "paper",
        choices=HIT_RULES,
    )
    out: Path = flag("file for the prediction", "JSON")
    json: bool = flag("print a summary as JSON")


def run(arguments: PredictArguments) -> None:
    """Read, predict, write."""
    if not (math.isfinite(arguments.observe_ms) and arguments.observe_ms > 0):
        raise CommandError(
            "nothing to predict from", expected="above 0", got=arguments.observe_ms, where="--observe-ms"
        )
    check_folder(arguments.out)
    constants = given_constants(arguments.constants, arguments.physics, arguments.method)
    paper = predictor_for(arguments.physics or "paper", hit_x_m=arguments.hit_x)
    points = read_points_file(arguments.points)
    t_s, ps_m = points.t_s, points.ps_m
    # The contract of `predict`: later rows give only the times that are asked for.
    seen = t_s < t_s[0] + 1e-3 * arguments.observe_ms
    if arguments.method == "filter":
        config = filter_for(arguments.physics or "paper")
        config = dataclasses.replace(config, perhaps_real=arguments.physics is None)
        config = config if constants is None else fitted_filter(config, constants)
        predictor = FilterPredictor(config, hit_x_m=paper.hit_x_m)
        needed = f"points over {config.least_seen_ms:g} ms"
    else:
        predictor = PaperPredictor(paper)
        needed_ms = (paper.observations - 1) * paper.spacing_ms
        needed = f"{paper.observations} points over {needed_ms:g} ms, all before or all after the bounce"
    prediction = _predict(predictor, t_s[seen], ps_m[seen])
    if prediction is None:
        raise CommandError(
            f"too little to predict from in the first {arguments.observe_ms:g} ms",
            expected=needed,
            got=f"{counted(int(seen.sum()), 'point')} over {1e3 * (t_s[seen][-1] - t_s[0]):.0f} ms",
            where=arguments.points,
            remedy="give a larger --observe-ms",
        )
    found = prediction_json(prediction, t_s[~seen])
    choice: HitChoice | None = None
    if arguments.hit == "chosen":
        controller = BuiltInController().for_physics(_physics(arguments, constants))
        choice = choose_from_rest(prediction, controller, predictor.bounces_us)
        found["chosen_hit"] = _choice_json(choice)
    write_text(arguments.out, json.dumps(found) + "\n")
    _say(arguments, prediction, choice, int(seen.sum()), points)


def prediction_json(prediction: Prediction, later_s: NDArray[np.float64]) -> dict[str, object]:
    """The prediction as the command writes it: positions at `later_s`, bounces, landing, hitting plane."""
    ps, sigmas = prediction.positions(later_s)
    return {
        "positions": [
            {"t_s": float(t), "p_world_m": p.tolist(), "sigma_m": sigma.tolist()}
            for t, p, sigma in zip(later_s, ps, sigmas, strict=True)
        ],
        "bounces": [_table_point_json(bounce) for bounce in prediction.bounces],
        "landing": None if prediction.landing is None else _table_point_json(prediction.landing),
        "hit_plane": None if prediction.hit_plane is None else _hit_plane_json(prediction.hit_plane),
    }


def _predict(
    predictor: PaperPredictor | FilterPredictor, t_s: NDArray[np.float64], ps_m: NDArray[np.float64]
) -> Prediction | None:
    """What a predictor says after points (N, 3) at times (N,)."""
    for t, p in zip(t_s, ps_m, strict=True):
        predictor.add(round(1e6 * t), p)
    return predictor.predict() if isinstance(predictor, FilterPredictor) else predictor.latest


def _table_point_json(point: TablePoint) -> dict[str, object]:
    return {"t_s": point.t_s, "p_world_m": point.p_world_m.tolist(), "sigma_m": point.sigma_m.tolist()}


def _hit_plane_json(plane: HitPlane) -> dict[str, object]:
    return {
        "t_s": plane.t_s,
        "sigma_t_s": plane.sigma_t_s,
        "p_world_m": plane.p_world_m.tolist(),
        "sigma_m": plane.sigma_m.tolist(),
        "v_world_mps": plane.v_world_mps.tolist(),
        "sigma_mps": plane.sigma_mps.tolist(),
        "stage": plane.stage,
    }


def _physics(arguments: PredictArguments, constants: FittedConstants | None) -> PhysicsConfig:
    """What the stroke is computed with: as the flight is predicted."""
    if constants is not None:
        return constants.physics()
    if arguments.physics is None and arguments.method == "filter":
        return expected_physics(PhysicsConfig())
    return physics_profile(arguments.physics or "paper")


def _choice_json(choice: HitChoice) -> dict[str, object]:
    """The chosen point, null if no stroke returns the ball, why none does, and all places in the ball's order."""
    chosen = None if choice.chosen is None else _place_json(choice.chosen)
    places = [_place_json(one) for one in choice.candidates]
    return {"chosen": chosen, "why_not": choice.explanation, "places": places}


def _place_json(place: HitCandidate) -> dict[str, object]:
    landing_m = place.landing_sigma_m if math.isfinite(place.landing_sigma_m) else None
    judged = {"chance": place.chance, "landing_sigma_m": landing_m, "why_not": place.why_not}
    return {**_hit_plane_json(place.hit), **judged}


def _say(
    arguments: PredictArguments, prediction: Prediction, choice: HitChoice | None, seen: int, points: PointsFile
) -> None:
    plane = prediction.hit_plane
    if arguments.json:
        summary = {
            "points": str(arguments.points),
            "observed": seen,
            "stage": prediction.stage,
            "bounces": len(prediction.bounces),
            "hit_plane": None if plane is None else _hit_plane_json(plane),
            "taken_for": points.taken_for,
            "notes": list(points.notes),
            "out": str(arguments.out),
        }
        if choice is not None:
            summary["chosen_hit"] = None if choice.chosen is None else _place_json(choice.chosen)
            summary["why_not"] = choice.explanation
        say(json.dumps(summary))
        return
    if plane is None:
        say(f"from {counted(seen, 'point')}: the ball does not come to x = {arguments.hit_x:g} m: {arguments.out}")
    else:
        y, z = plane.p_world_m[1:]
        after_ms = 1e3 * plane.t_s - 1e-3 * prediction.t_us
        say(
            f"from {counted(seen, 'point')}, {prediction.stage}-bounce: at x = {arguments.hit_x:g} m "
            f"in {after_ms:.0f} ms, y {y:.3f} m, z {z:.3f} m: {arguments.out}"
        )
    if choice is not None and choice.chosen is not None:
        x, y, z = choice.chosen.hit.p_world_m
        after_ms = 1e3 * choice.chosen.hit.t_s - 1e-3 * prediction.t_us
        place = f"x {x:.2f} m, y {y:.3f} m, z {z:.3f} m"
        say(f"  best hit in {after_ms:.0f} ms: {place}, chance to return it {choice.chosen.chance:.0%}")
    elif choice is not None:
        say(f"  {choice.explanation}")
    print_lines(f"  {arguments.points.name}: {line}" for line in (points.taken_for, *points.notes))
