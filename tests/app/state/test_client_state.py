import pytest

from app.state.client_state import Playhead


def test_it_moves_with_the_wall_clock_only_while_it_plays() -> None:
    head = Playhead(1_000_000, speed=0.5).play(10.0)
    assert head.position_us(10.0) == 0 and head.position_us(11.0) == 500_000
    stopped = head.pause(10.5)
    assert stopped.position_us(10.5) == stopped.position_us(99.0) == 250_000


def test_it_never_leaves_the_recording_and_stops_at_its_end() -> None:
    head = Playhead(1_000_000, speed=1.0).play(0.0)
    assert head.position_us(50.0) == 1_000_000 and head.position_us(-50.0) == 0
    assert head.settle(0.5).playing and not head.settle(50.0).playing
    assert head.seek(-5, 0.0).position_us(0.0) == 0 and head.seek(2**70, 0.0).position_us(0.0) == 1_000_000


def test_play_at_the_end_begins_again() -> None:
    assert Playhead(1_000, anchor_us=1_000).play(3.0).position_us(3.0) == 0


def test_a_step_pauses_and_a_seek_does_not() -> None:
    head = Playhead(1_000_000, speed=1.0).play(0.0)
    assert head.seek(400_000, 0.2).playing
    stepped = head.step(-100_000, 0.3)
    assert not stepped.playing and stepped.position_us(9.0) == 200_000


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_an_impossible_speed_changes_nothing(speed: float) -> None:
    head = Playhead(1_000_000, speed=1.0).play(0.0)
    assert head.at_speed(speed, 0.5) == head


def test_a_change_of_speed_does_not_jump() -> None:
    head = Playhead(1_000_000, speed=1.0).play(0.0).at_speed(0.1, 0.3)
    assert head.position_us(0.3) == 300_000 and head.position_us(1.3) == 400_000


def test_a_section_is_played_again_and_again() -> None:
    head = Playhead(1_000_000, speed=1.0).looping((200_000, 300_000), 0.0).play(0.0)
    assert head.position_us(0.0) == 200_000  # it begins in the section
    assert [head.position_us(at) for at in (0.05, 0.1, 0.25, 1.03)] == [250_000, 200_000, 250_000, 230_000]
    assert head.settle(50.0).playing


def test_a_seek_out_of_the_section_plays_on_and_into_it_loops() -> None:
    head = Playhead(1_000_000, speed=1.0).looping((200_000, 300_000), 0.0).play(0.0)
    assert head.seek(500_000, 0.0).position_us(0.2) == 700_000
    assert head.seek(150_000, 0.0).position_us(0.1) == 250_000
    assert head.looping(None, 0.05).position_us(0.2) == 400_000


def test_a_section_too_short_to_see_is_none() -> None:
    assert Playhead(1_000_000).looping((5, 5), 0.0).loop_us is None
    assert Playhead(1_000_000).looping((300_000, 100_000), 0.0).loop_us == (100_000, 300_000)
    assert Playhead(1_000_000).looping((-5, 9_000_000), 0.0).loop_us == (0, 1_000_000)


def test_only_what_moves_in_a_complete_recording_is_a_playback() -> None:
    playing = Playhead(1_000_000).play(0.0)
    assert playing.is_playback and not playing.pause(1.0).is_playback and not playing.step(1000, 1.0).is_playback
    assert not Playhead(1_000_000, live=True).play(0.0).is_playback
