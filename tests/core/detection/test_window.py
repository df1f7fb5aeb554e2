from core.detection.window import windows_between


def test_windows_follow_one_another_and_none_is_partial(make_scene) -> None:
    scene = make_scene(duration_us=10_500, noise_hz=50.0)
    windows = list(windows_between(scene, 0, 10_500, 2000))
    assert [(w.start_us, w.end_us) for w in windows] == [(s, s + 2000) for s in range(0, 10_000, 2000)]
    assert sum(len(w.events) for w in windows) == len(scene.events.between(0, 10_000)) > 0


def test_a_stretch_shorter_than_a_window_has_none(make_scene) -> None:
    assert list(windows_between(make_scene(), 0, 1999, 2000)) == []
