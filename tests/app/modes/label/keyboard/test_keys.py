from app.modes.label.keyboard.keys import KEYS, label_keys_html
from app.panels.keys import KEYS as OTHER_KEYS


def test_no_key_is_taken_twice_moves_the_camera_or_chooses_a_mode() -> None:
    taken = [(key, modifier) for key, modifier, _, _ in KEYS]
    assert len(set(taken)) == len(taken)
    plain = {key for key, _ in taken}
    assert not plain & set("WASDQE") and not any(key.startswith("arrow") for key in plain) and "tab" not in plain
    assert not plain & set("MTO")


def test_every_key_is_listed_for_the_person() -> None:
    shown = label_keys_html()
    assert all(text in shown for _, _, name, text in KEYS if not name.endswith("_more"))
    assert {"N", "P", "Z"} <= {key for key, _, _ in OTHER_KEYS}  # the same hands in the other modes
