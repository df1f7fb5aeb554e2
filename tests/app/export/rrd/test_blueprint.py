"""Blueprints have all settings that the installed Rerun knows, and no others."""

import inspect

import rerun.blueprint as rrb

from app.export.rrd.blueprint import eye, recording_blueprint, run_blueprint
from app.export.rrd.paths import EPISODE, TIMELINE


def test_the_eye_has_its_place_where_rerun_knows_one() -> None:
    assert isinstance(eye(), rrb.EyeControls3D)
    known = {"position", "look_target", "eye_up"} & set(inspect.signature(rrb.EyeControls3D).parameters)
    assert [name for name in known if getattr(eye(), name) is None] == []
    assert len(known) in (0, 3)


def test_the_time_panel_has_its_timeline_where_rerun_knows_one() -> None:
    known = {"timeline", "playback_speed", "play_state"} & set(inspect.signature(rrb.TimePanel).parameters)
    for blueprint in (recording_blueprint({"left": True}, rewards=False), run_blueprint(["seed-0"], {})):
        panel = blueprint.time_panel
        assert panel is not None
        assert "timeline" not in known or str(panel.timeline) in (TIMELINE, EPISODE)
