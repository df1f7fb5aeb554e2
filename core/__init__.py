"""What Rallyscope computes: events, recordings, cameras, detection, simulation, evaluation.

Nothing in here knows a browser, a command line or a user: no viser, no rerun, no printing.
The layers inside, and what may import torch or mujoco, are checked by `make check` and the architecture tests.
"""
