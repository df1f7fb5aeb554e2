import random

from app.state.client_state import MERGE_WITHIN_S, History


def test_undo_and_redo_walk_through_the_steps() -> None:
    history = History(0).change(1, topic="a", wall_s=0).change(2, topic="b", wall_s=0)
    assert history.undo().present == 1
    assert history.undo().undo().present == 0
    assert history.undo().undo().undo().present == 0
    assert history.undo().undo().redo().redo().present == 2
    assert history.redo().present == 2


def test_a_drag_is_one_step_and_a_pause_ends_it() -> None:
    history = History(0)
    for number in range(1, 10):
        history = history.change(number, topic="slider", wall_s=number * MERGE_WITHIN_S * 0.9)
    assert history.present == 9 and history.undo().present == 0
    later = history.change(10, topic="slider", wall_s=100.0)
    assert later.undo().present == 9


def test_steps_without_a_topic_never_join() -> None:
    history = History(0).change(1, topic=None, wall_s=0).change(2, topic=None, wall_s=0)
    assert history.undo().present == 1


def test_a_change_after_an_undo_forgets_what_was_undone() -> None:
    history = History(0).change(1, topic=None, wall_s=0).undo().change(5, topic=None, wall_s=0)
    assert history.redo().present == 5 and history.undo().present == 0


def test_a_drag_right_after_an_undo_is_a_step_of_its_own() -> None:
    history = History(0).change(1, topic="x", wall_s=0.0).undo().change(7, topic="x", wall_s=0.1)
    assert history.undo().present == 0


def test_any_number_of_changes_undone_gives_the_first_value() -> None:
    rng = random.Random(5)
    history = History(-1)
    for _ in range(2000):
        act = rng.choice(("change", "change", "undo", "redo"))
        if act == "change":
            history = history.change(rng.randrange(5), topic=rng.choice((None, "a", "b")), wall_s=rng.random() * 5)
        else:
            history = getattr(history, act)()
    while history.past:
        history = history.undo()
    assert history.present == -1
