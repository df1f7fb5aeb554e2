"""A trained actor as an ONNX graph for robots: physical units in, racket angles out."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Final

import numpy as np
from onnx import ModelProto, NodeProto, TensorProto, checker, helper, numpy_helper

from app.export.task import RunTask
from app.export.unfinished import unfinished_file
from core.errors import CommandError
from core.learning.agents.policy import Policy
from core.learning.config import RunConfig
from core.learning.runs.run_files import load_policy, read_run
from core.learning.task.normalise import GOAL_CENTRE, GOAL_SCALE, STATE_CENTRE, STATE_LIMIT, STATE_SCALE

OPSET: Final = 17
IR_VERSION: Final = 8
"""ONNX IR version of 2022: the graph needs nothing newer, so older runtimes on robots can read it."""
STATE: Final = "(N, 6) ball at the hitting plane, world frame: x, y, z in m, then vx, vy, vz in m/s"
GOAL: Final = "(N, 2) where it is to land in the plane of the table, world frame: x, y in m"
ANGLES: Final = "(N, 3) turns of the racket in rad about its own x, then y, then z, after the base orientation"


def export_actor(task: RunTask) -> tuple[Path, ...]:
    """Write the actor of a seed of a run (its first by default).

    Raises:
        ConfigError: if the folder holds no run, or no policy.
        CommandError: if the policy needs more than state and goal.
    """
    config, policy = read_run(task.run), load_policy(task.run, task.order.seed, task.order.policy)
    if policy.sees_racket_speed or policy.chooses_speed:
        raise CommandError(
            "not an actor of state and goal alone", expected="any agent but the landing model", got=config.agent
        )
    if policy.state != "plain":
        raise CommandError("an actor of states with spin", expected="one of p_c and v_c", got=policy.state)
    with unfinished_file(task.path, overwrite=task.order.overwrite) as unfinished:
        unfinished.write_bytes(actor_model(policy, config).SerializeToString())
    return (task.path,)


def actor_model(policy: Policy, config: RunConfig) -> ModelProto:
    """`state` and `goal` to `angles_rad`, all float32; normalising, clipping and scaling are in the graph."""
    stroke = config.environment.task.stroke
    constants = {
        "state_centre": STATE_CENTRE,
        "state_scale": STATE_SCALE,
        "state_low": -STATE_LIMIT,
        "state_high": STATE_LIMIT,
        "goal_centre": GOAL_CENTRE,
        "goal_scale": GOAL_SCALE,
        "action_low": -1.0,
        "action_high": 1.0,
        "limit_rad": math.radians(stroke.action_limit_deg),
    }
    for i, (weight, bias) in enumerate(policy.layers):
        constants |= {f"weight_{i}": weight, f"bias_{i}": bias}
    graph = helper.make_graph(
        _nodes(policy),
        "actor",
        [
            helper.make_tensor_value_info("state", TensorProto.FLOAT, ["N", 6], STATE),
            helper.make_tensor_value_info("goal", TensorProto.FLOAT, ["N", 2], GOAL),
        ],
        [helper.make_tensor_value_info("angles_rad", TensorProto.FLOAT, ["N", 3], ANGLES)],
        [numpy_helper.from_array(np.array(value, np.float32), name) for name, value in constants.items()],
    )
    model = helper.make_model(
        graph, producer_name="rallyscope", ir_version=IR_VERSION, opset_imports=[helper.make_opsetid("", OPSET)]
    )
    speeds = {"incoming_mps": policy.incoming_mps.tolist(), "racket_mps": policy.racket_mps.tolist()}
    about = {"state": STATE, "goal": GOAL, "angles_rad": ANGLES, "agent": config.agent}
    about |= {"base_pitch_deg": f"{stroke.base_pitch_deg:g}", "racket_speed": json.dumps(speeds)}
    helper.set_model_props(model, about)
    # A graph that the checker refuses would fail in the user's runtime, far from here.
    checker.check_model(model)
    return model


def _nodes(policy: Policy) -> list[NodeProto]:
    node = helper.make_node
    nodes = [
        node("Sub", ["state", "state_centre"], ["state_moved"]),
        node("Div", ["state_moved", "state_scale"], ["state_scaled"]),
        node("Clip", ["state_scaled", "state_low", "state_high"], ["state_normal"]),
        node("Sub", ["goal", "goal_centre"], ["goal_moved"]),
        node("Div", ["goal_moved", "goal_scale"], ["goal_normal"]),
        node("Concat", ["state_normal", "goal_normal"], ["input_0"], axis=1),
    ]
    last = len(policy.layers) - 1
    activation = {"relu": "Relu", "tanh": "Tanh"}[policy.hidden]
    for i in range(last + 1):
        nodes.append(node("Gemm", [f"input_{i}", f"weight_{i}", f"bias_{i}"], [f"linear_{i}"]))
        if i < last:
            nodes.append(node(activation, [f"linear_{i}"], [f"input_{i + 1}"]))
    if policy.output == "tanh":
        nodes.append(node("Tanh", [f"linear_{last}"], ["action"]))
    else:
        nodes.append(node("Clip", [f"linear_{last}", "action_low", "action_high"], ["action"]))
    return [*nodes, node("Mul", ["action", "limit_rad"], ["angles_rad"])]
