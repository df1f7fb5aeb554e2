"""The chain from events to a racket: detect in every camera, triangulate, predict, decide."""
