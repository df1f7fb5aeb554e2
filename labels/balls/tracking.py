"""Balls of a recording that says nothing of them: found by the tracker, which takes as long as `rallyscope track`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from core.chain.chain import ChainState, RallyChain
from core.chain.config import WINDOW_US, ChainConfig
from core.chain.follow import REPORT_EVERY, calibrated_cameras
from core.detection.window import windows_side_by_side
from core.history.rally_history import FLIGHT_GAP_US, trail_velocities_mps
from core.recordings import Recording
from labels.assist.contact_proposals import propose_contacts
from labels.assist.propose import Proposals
from labels.balls.rows import TRACKED, BallRow, FlownPath, rows_of_path


def rows_of_track(
    recording: Recording,
    *,
    progress: Callable[[float], None] = lambda share: None,
    cancelled: Callable[[], bool] = lambda: False,
) -> list[BallRow]:
    """Flights and contacts of the balls that the chain follows; empty if cancelled.

    Raises:
        CalibrationError: if there are fewer than two cameras, or one has no calibration.
    """
    cameras = calibrated_cameras(recording)
    chain, states = RallyChain(cameras, ChainConfig()), []
    windows = windows_side_by_side(recording.cameras, 0, recording.duration_us, WINDOW_US)
    for number, each in enumerate(windows):
        if cancelled():
            return []
        states.append(chain.step(each))
        if number % REPORT_EVERY == 0:
            progress(states[-1].t_us / recording.duration_us)
    proposals = [_proposals(states, name) for name in cameras]
    contacts = propose_contacts(tuple(cameras.values()), proposals)
    return rows_of_path(_path(states, [one.t_us for one in contacts]), contacts, TRACKED)


def _proposals(states: list[ChainState], camera: str) -> Proposals:
    found = [one for state in states if (one := state.detections[camera]) is not None]
    t_us, columns = np.array([one.t_us for one in found], np.int64), [(one.u_px, one.v_px, one.r_px) for one in found]
    x, y, r = np.array(columns, np.float64).reshape(-1, 3).T
    return Proposals(t_us, x, y, r, np.full((len(t_us), 3), np.nan), WINDOW_US, TRACKED)


def _path(states: list[ChainState], contacts_us: list[int]) -> FlownPath:
    """The accepted points, with the spin of each ball; a speed is not taken across a contact."""
    seen = [(state, state.point) for state in states if state.point is not None]
    t_us = np.array([point.t_us for _, point in seen], np.int64)
    ps = np.array([point.p_world_m for _, point in seen], np.float64).reshape(-1, 3)
    begins = np.diff(t_us, prepend=t_us[:1] - FLIGHT_GAP_US - 1) > FLIGHT_GAP_US
    begins |= np.array([state.verdict == "new flight" for state, _ in seen], np.bool_)
    vs, spins, sigmas = np.full(ps.shape, np.nan), np.full(ps.shape, np.nan), np.full(len(t_us), np.nan)
    for part in np.split(np.arange(len(t_us)), np.union1d(np.flatnonzero(begins), np.searchsorted(t_us, contacts_us))):
        vs[part] = trail_velocities_mps(t_us[part], ps[part])
    for part in np.split(np.arange(len(t_us)), np.flatnonzero(begins)):
        hits = [one.prediction.hit_plane for one, _ in (seen[row] for row in part) if one.prediction is not None]
        known = [(hit.spin_radps, hit.spin_sigma_radps) for hit in hits if hit is not None]
        if known and known[-1][0] is not None and known[-1][1] is not None:
            spin, sigma = known[-1]
            spins[part], length = spin, np.linalg.norm(spin)
            # First order: of a spin near 0 the direction is not known, and any of its components may be the magnitude.
            sigmas[part] = np.linalg.norm(spin * sigma) / length if length > 0 else np.linalg.norm(sigma)
    return FlownPath(t_us, ps, vs, spins, sigmas, begins)
