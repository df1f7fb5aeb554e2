"""The chain from events to a racket: detect in every camera, triangulate, predict, decide."""

from core.rally.chain import BallPoint, ChainState, RallyChain
from core.rally.config import ChainConfig
from core.rally.controller import BuiltInController, Controller, ControllerConfig, RacketCommand

__all__ = [
    "BallPoint",
    "BuiltInController",
    "ChainConfig",
    "ChainState",
    "Controller",
    "ControllerConfig",
    "RacketCommand",
    "RallyChain",
]
