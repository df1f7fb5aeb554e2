"""Tune, in a real browser. The screenshots are kept under test-artifacts/."""

import re
from dataclasses import replace

import pytest

from app.modes.tune import settings
from app.pictures.canvas import Region
from app.state.commands import SetMethod, SetOverlay, SetZoom, UseConfig
from core.config import get_setting, replace_setting
from core.detection import DetectorConfig, refined_config
from core.detection.saved import RIMLESS, load_detector
from core.metrics.run import MethodSample
from tests.app.browser.window import ARTIFACTS, choose_in, count_like, wait_until_sent
from tests.waiting import eventually

YELLOW, GREEN = (255, 225, 60), (165, 225, 40)
BALL_US = 300_000
COLOUR = "mark => getComputedStyle(mark).backgroundColor"
RADIUS_MAX = ("localise", "radius_max_px")


@pytest.fixture
def tune(window):
    """A window in Tune at a moment with a ball, with a method that has stages."""
    window.session.send(SetMethod("auto"))
    window.seek(BALL_US)
    window.press("Tune")
    eventually(lambda: window.state.mode == "Tune", "Tune")
    window.page.get_by_text("ball at").first.wait_for()
    return window


def test_it_begins_with_refined_and_the_file_that_is_saved_names_it(window, workspace) -> None:
    window.seek(BALL_US)
    window.press("Tune")
    window.page.get_by_text("moves (").first.wait_for()
    plot = window.page.get_by_role("img", name=re.compile("^residuals"))
    panel = window.page.locator("[data-scrollarea-viewport]").filter(has=plot).last.bounding_box()
    box = plot.bounding_box()
    assert box["y"] + box["height"] <= panel["y"] + panel["height"], "the residuals are seen without scrolling"
    assert window.field("motion [px]").is_visible()
    window.fill(window.field("Name"), "mine")
    window.press("Save")
    window.page.get_by_text("Saved as mine").wait_for()
    path = workspace.root / "configs" / "mine.toml"
    assert load_detector(path) == ("refined", refined_config()) == window.state.detector


def test_the_settings_for_a_ball_without_a_rim_are_offered_and_undone(window, monkeypatch) -> None:
    where = "app.modes.tune.nothing_found"
    monkeypatch.setattr(f"{where}.best_other", lambda *_: None)
    monkeypatch.setattr(f"{where}.sample_rimless", lambda *_, **__: MethodSample("refined", 300, 215, ()))
    strict = replace_setting(refined_config(), ("refined", "points_min"), 200)
    window.session.send(UseConfig(strict, "refined"))
    window.seek(BALL_US)
    window.press("Tune")
    window.page.get_by_text("with the settings for a ball without a rim: 72").wait_for()
    window.page.screenshot(path=ARTIFACTS / "tune-rimless.png")
    window.press("Use the settings for a ball without a rim")
    eventually(lambda: window.state.config == load_detector(RIMLESS).config, "the settings")
    window.press("Undo")
    eventually(lambda: window.state.config == strict, "undone")


def use_defaults(tune) -> None:
    """The settings as they were before a part of a journey changed them."""
    tune.session.send(UseConfig(DetectorConfig()))
    eventually(lambda: tune.state.configs.present.a == DetectorConfig(), "the settings of the start")


def the_stages_show_the_ball_its_hull_and_its_circle(tune) -> None:
    canvas = tune.wait_for_pixels("tune", lambda canvas: count_like(canvas, YELLOW) > 40)
    assert canvas.std() > 1
    for stage in ("denoise", "cluster", "geometry"):
        assert tune.page.get_by_text(stage.capitalize(), exact=True).count() >= 1


def sliders_of_the_stage_that_is_shown_and_four_clusters_are_seen_without_scrolling(tune, stage) -> None:
    config = DetectorConfig()
    cluster = replace(config.cluster, eps_px=1, min_samples=1, size_min=1)
    config = replace(config, cluster=cluster, roi=replace(config.roi, enabled=False))
    tune.session.send(UseConfig(replace(config, denoise=replace(config.denoise, kernel_px=1))))
    tune.session.send(SetOverlay("clusters" if stage == "cluster" else "geometry"))
    rows = tune.page.locator("td", has_text=re.compile("^(ON|OFF)$"))
    eventually(lambda: rows.count() >= 4, "four clusters")
    panel = tune.page.locator("[data-scrollarea-viewport]").filter(has=rows.first).last.bounding_box()
    fourth = rows.nth(3).bounding_box()
    assert fourth["y"] + fourth["height"] <= panel["y"] + panel["height"] + 1
    mark = tune.page.locator(f"#stage-{stage}")
    eventually(lambda: 0 < mark.bounding_box()["y"] < 600, "the stage's sliders at the top")
    last = tune.field({"cluster": "size max", "geometry": "solidity min"}[stage])

    def is_seen() -> bool:
        box = last.bounding_box()
        return box["y"] + box["height"] < 720

    eventually(is_seen, "its last slider, too")
    tune.screenshot(f"tune-at-once-{stage}")


def a_slider_changes_the_overlay_and_undo_brings_it_back(tune) -> None:
    tune.wait_for_pixels("before", lambda canvas: count_like(canvas, YELLOW) > 40)
    tune.fill(tune.field("radius max [px]"), "5")
    eventually(lambda: get_setting(tune.state.config, RADIUS_MAX) == 5, "the setting")
    tune.page.get_by_text("no ball").first.wait_for()
    tune.wait_for_pixels("rejected", lambda canvas: count_like(canvas, YELLOW) < 10)
    assert tune.page.get_by_text("> 5").count() >= 1, "the table says why"
    tune.field("radius max [px]").blur()
    tune.page.keyboard.press("z")
    eventually(lambda: tune.state.config == DetectorConfig(), "undo")
    tune.wait_for_pixels("undone", lambda canvas: count_like(canvas, YELLOW) > 40)


def two_configs_are_compared_on_one_window(tune) -> None:
    tune.press("B")
    eventually(lambda: tune.state.tune.slot == "B", "slot B")
    tune.fill(tune.field("radius max [px]"), "5")
    eventually(lambda: get_setting(tune.state.config, RADIUS_MAX) == 5, "the setting of B")
    tune.field("Compare A and B").click()
    eventually(lambda: len(tune.session.sheet.pictures) == 2, "two pictures")
    tune.page.get_by_text("Config B:").first.wait_for()
    tune.page.get_by_text("ball at").first.wait_for()
    tune.page.get_by_text("no ball").first.wait_for()
    tune.screenshot("compare")


def zoom_follows_the_ball_and_a_click_centres_it_elsewhere(tune) -> None:
    """Following is offered only where it does something."""
    assert tune.page.get_by_role("button", name="Follow the ball: zoom in first").is_disabled()
    tune.fill(tune.field("Zoom"), "8")
    assert tune.page.get_by_role("button", name="Follow the ball: already on").is_disabled()
    sensor = tune.session.recording.cameras[tune.state.camera].sensor
    eventually(lambda: has_shape_of_middle(tune, sensor.height_px / 8), "the zoomed view, as wide as the middle")
    region = region_of(tune)
    truth = tune.page.get_by_text("ball at (").first.inner_text()
    u, v = map(float, re.findall(r"\d+\.\d", truth)[:2])
    middle_px = region.x + (region.width - 1) / 2, region.y + (region.height - 1) / 2
    assert abs(middle_px[0] - u) <= 1 and abs(middle_px[1] - v) <= 1
    tune.click_picture(100, 100)
    eventually(lambda: tune.state.tune.centre_px is not None, "the click")
    assert tune.state.tune.centre_px[0] < middle_px[0] and tune.state.tune.centre_px[1] < middle_px[1]
    tune.screenshot("zoom")
    follow_again(tune, region)


def region_of(tune) -> Region:
    return tune.session.sheet.pictures[0].region


def has_shape_of_middle(tune, height_px: float) -> bool:
    """Whether the region is this high, and as wide as the window leaves: no black bands beside the picture."""
    region = region_of(tune)
    return (region.width, region.height) == (round(height_px * tune.session.plane.free_aspect), round(height_px))


def follow_again(tune, region: Region) -> None:
    """As the button does it, back to the ball."""
    tune.page.get_by_role("button", name="Follow the ball", exact=True).click()
    eventually(lambda: tune.state.tune.centre_px is None, "the view to follow the ball again")
    eventually(lambda: region_of(tune) == region, "the view of the ball")


def a_rejected_ball_stays_in_view_in_red_and_its_verdict_leads_to_its_sliders(tune) -> None:
    region = region_of(tune)
    tune.fill(tune.field("radius max [px]"), "5")
    tune.page.get_by_text("no ball").first.wait_for()
    assert region_of(tune) == region
    tune.wait_for_pixels("tune-rejected", lambda canvas: count_like(canvas, (255, 70, 70), 30) > 100)
    tune.field("Zoom").evaluate("field => field.scrollIntoView()")
    slider = tune.page.locator("#setting-localise-radius-max-px")
    assert slider.bounding_box()["y"] > 720
    tune.page.get_by_role("link", name=re.compile(r"radius .* > 5")).first.click()
    eventually(lambda: 0 < slider.bounding_box()["y"] < 720, "the slider of the limit")
    eventually(lambda: slider.evaluate(COLOUR) == "rgb(255, 140, 40)", "its mark")
    tune.screenshot("tune-verdict")


def a_click_on_a_cluster_puts_its_row_first(tune) -> None:
    region = region_of(tune)
    tune.click_picture(435, 250)  # the ball is in the middle
    row = tune.page.locator("tr[style*=background]")
    row.wait_for()
    assert "ball" in row.inner_text()
    follow_again(tune, region)


TYPE_AND_PRESS = """(field, save) => {
    const set = Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set;
    for (const text of ["b", "bu", "bus", "busy"]) {
        set.call(field, text);
        field.dispatchEvent(new Event("input", { bubbles: true }));
    }
    save.click();
}"""
"""As a page that was drawing meanwhile handles them: the letters and the click in one go."""


def what_was_typed_just_before_a_click_is_not_lost(tune, workspace) -> None:
    save = tune.page.get_by_role("button", name="Save", exact=True).element_handle()
    tune.field("Name").evaluate(TYPE_AND_PRESS, save)
    eventually(lambda: list((workspace.root / "configs").glob("*.toml")), "the file")
    tune.page.get_by_text("Saved as busy").wait_for()
    assert (workspace.root / "configs" / "busy.toml").exists()


def a_config_is_saved_under_a_plain_name_and_loads_again(tune, workspace) -> None:
    tune.fill(tune.field("radius max [px]"), "17")
    eventually(lambda: get_setting(tune.state.config, RADIUS_MAX) == 17, "the setting")
    tune.fill(tune.field("Name"), "../My config")
    tune.press("Save")
    path = workspace.root / "configs" / "my-config.toml"
    eventually(path.exists, "the file")
    assert load_detector(path) == tune.state.detector
    eventually(lambda: tune.field("Saved").input_value() == "my-config", "the choice of what was just saved")
    tune.press("Reset")
    eventually(lambda: tune.state.config == DetectorConfig(), "reset")
    tune.press("Save")
    tune.page.get_by_text("Saved as my-config-2").wait_for()
    tune.fill(tune.field("radius max [px]"), "18")
    eventually(lambda: get_setting(tune.state.config, RADIUS_MAX) == 18, "another setting")
    tune.fill(tune.field("Name"), "My config")
    tune.field("Name").press("Enter")
    tune.page.get_by_text("Saved as my-config-3").wait_for()
    assert get_setting(load_detector(path).config, RADIUS_MAX) == 17, "nor by Enter"
    tune.press("Undo")
    eventually(lambda: tune.state.config == DetectorConfig(), "undo")
    tune.field("Name").press("Enter")
    tune.page.get_by_text("Saved as my-config-2").last.wait_for()
    assert load_detector(path).config != DetectorConfig(), "nothing is overwritten"
    assert len(list(path.parent.glob("my-config*.toml"))) == 3
    eventually(lambda: tune.field("Saved").input_value() == "my-config-2", "the choice of the second")
    choose_in(tune.page.get_by_label("Saved").first, "my-config")
    tune.press("Load")
    eventually(lambda: get_setting(tune.state.config, RADIUS_MAX) == 17, "the loaded config")


def a_number_is_judged_when_it_is_complete(tune) -> None:
    """The 5 of 500 is outside of the bounds: no complaint, and the box shows what is used."""
    page, window = tune.page, tune.field("window [µs]")

    def shown() -> int:
        return int(window.input_value())

    def used() -> int:
        return tune.state.config.window.window_us

    for typed, key, expected in (("500", "Tab", 500), ("5", "Enter", 50), ("800", "Tab", 800), ("60", "Enter", 60)):
        window.dblclick()
        page.keyboard.type(typed)
        page.keyboard.press(key)
        eventually(lambda expected=expected: used() == expected == shown(), f"{typed} and {key} to give {expected}")
    assert page.get_by_text("Out of range").count() == 0


def a_number_may_be_typed_through_values_that_do_not_go_with_the_others(tune, monkeypatch) -> None:
    """The 3 of 30 lies below the smallest radius: what is shown at the end is what is used, and nothing complains."""
    largest, complaint = tune.field("radius max [px]"), tune.page.get_by_text("No radius is allowed")
    tune.fill(tune.field("radius min [px]"), "10")
    eventually(lambda: tune.state.config.localise.radius_min_px == 10, "the smallest radius")
    monkeypatch.setattr(settings, "REST_S", float("inf"))  # however long it takes from one letter to the next
    largest.dblclick()
    tune.page.keyboard.type("30", delay=200)
    tune.page.keyboard.press("Enter")
    eventually(lambda: tune.state.config.localise.radius_max_px == 30, "the largest radius")
    assert float(largest.input_value()) == 30 and complaint.count() == 0

    monkeypatch.undo()
    largest.fill("3")  # and no more of it
    largest.press("Enter")
    complaint.wait_for()
    eventually(lambda: float(largest.input_value()) == 30, "the value that is used")


def a_config_is_scored_over_the_recording(tune) -> None:
    tune.page.get_by_role("tab", name="Score").click()
    tune.press("Score this config on the whole recording")
    row = tune.page.get_by_role("row").filter(has_text="serve, left, auto, config A").first
    row.wait_for()
    tune.screenshot("score")
    assert re.search(r"\t\d\.\d\d ms", row.inner_text()), "the newest answer is a few windows old at most"
    tune.fill(tune.field("Extra latency [ms]"), "30")
    row.get_by_text(re.compile(r"^3\d\.\d\d ms$")).wait_for()
    tune.screenshot("score-in-time")
    tune.fill(tune.field("Window ends [px]"), "3")
    tune.press("Score this config on the whole recording")
    tune.page.get_by_role("row").filter(has_text="windows end after 3 px of motion").first.wait_for()
    tune.screenshot("score-of-early-windows")
    tune.fill(tune.field("Window ends [px]"), "0")
    tune.fill(tune.field("Extra latency [ms]"), "0")


def thresholds_are_tuned_and_the_result_is_b_beside_a(tune) -> None:
    tune.fill(tune.field("Trials"), "24")
    tune.screenshot("auto-tune-form")
    for name in ("Thresholds", "Geometry"):
        folder = tune.page.get_by_text(name, exact=True).last
        tune.wait_until_at_rest(folder)  # a click on a form that still unfolds may miss
        folder.click()
    tune.screenshot("auto-tune-thresholds")
    start = tune.state.configs.present.a
    tune.press("Tune automatically")
    tune.page.get_by_text("of 24 trials").wait_for()
    tune.screenshot("auto-tune-running")
    trials = tune.page.get_by_text("of 24 trials")
    while not tune.state.tune.compare:
        said = trials.all_inner_texts()
        eventually(lambda said=said: tune.state.tune.compare or trials.all_inner_texts() != said, "the next trial")
    configs = tune.state.configs.present
    assert configs.a == start and tune.state.tune.slot == "B"
    tune.page.get_by_role("tab", name="Auto-tune").click()
    tune.page.get_by_text("held out", exact=True).wait_for()
    assert tune.page.get_by_text("importance", exact=True).count() == 1
    eventually(lambda: len(tune.session.sheet.pictures) == 2, "two pictures")
    tune.screenshot("auto-tune")
    tune.key("z")
    eventually(lambda: tune.state.configs.present.b == start, "undo")


def tuning_that_is_cancelled_changes_nothing_and_can_be_started_again(tune) -> None:
    before = tune.state.configs.present
    tune.fill(tune.field("Trials"), "400")  # not over before a slow page is told to cancel
    for _ in range(2):
        tune.press("Tune automatically")
        tune.page.get_by_text("of 400 trials").wait_for()
        tune.press("Cancel tuning")
        tune.page.get_by_text("of 400 trials").wait_for(state="hidden")
    assert tune.state.configs.present == before and not tune.state.tune.compare


def tuning_against_labels_that_there_are_not_says_so(tune) -> None:
    choose(tune, "Against", "labels")
    tune.press("Tune automatically")
    tune.page.get_by_text("this camera has no labels").wait_for()
    tune.page.get_by_role("button", name="Tune automatically").wait_for()
    choose(tune, "Against", "truth")


def choose(tune, label: str, option: str) -> None:
    """Choose in the dropdown of that label."""
    labelled = tune.page.locator("label").filter(has_text=re.compile(f"^{label}$"))
    choose_in(labelled.locator("xpath=ancestor::*[.//input][1]").locator("input").first, option)


def click_all(tune, *labels: str) -> None:
    """Click boxes, each once the one before was sent."""
    for label in labels:
        tune.field(label).click()
        wait_until_sent(tune.page)


def another_method_shows_its_ball_its_own_stages_and_sliders(tune) -> None:
    choose(tune, "Method", "refined")
    eventually(lambda: tune.state.tune.method == "refined", "the method")
    tune.page.get_by_text("moves (").first.wait_for()
    tune.wait_for_pixels("tune-refined", lambda canvas: count_like(canvas, YELLOW) > 40)
    motion = tune.field("motion [px]")
    assert motion.is_visible() and tune.page.get_by_text("circularity min").count() == 0
    assert tune.page.get_by_role("button", name="edge points").is_visible(), "its own stages"
    assert tune.page.get_by_role("button", name="clusters").count() == 0
    tune.fill(motion, "5")
    eventually(lambda: tune.state.config.refined.motion_px == 5.0, "the setting")
    assert tune.state.configs.present.a == DetectorConfig()
    tune.fill(tune.field("radius max [px]"), "4")
    tune.page.get_by_text("no ball").first.wait_for()
    choose(tune, "Method", "paper")
    tune.page.get_by_text("circularity min").first.wait_for()
    assert tune.page.get_by_text("leading polarity").count() == 0, "the paper decides that itself"
    tune.wait_for_pixels("tune-paper", lambda canvas: count_like(canvas, YELLOW) > 40)


def use_refined(tune, config: DetectorConfig) -> None:
    """Settings of refined; the method in use stays."""
    tune.session.send(UseConfig(config, "refined"))
    tune.session.send(SetMethod("auto"))
    eventually(lambda: tune.state.config_of("refined") == config and tune.state.tune.method == "auto", "the settings")
    tune.page.get_by_role("button", name="clusters").wait_for()  # auto's sliders move what is below them


def methods_are_compared_over_the_recording_and_a_click_on_a_miss_jumps_there(tune) -> None:
    config = refined_config()  # which finds every ball of this recording: it misses what is larger than its largest
    use_refined(tune, replace(config, refined=replace(config.refined, radius_max_px=4.0)))
    tune.field("paper").check()
    compared = ("auto", "paper", "refined")
    eventually(lambda: tune.state.tune.compared == compared, "the third method", lambda: tune.state.tune.compared)
    tune.screenshot("compare-form")
    tune.press("Compare over time")
    tune.page.get_by_text("against the truth").wait_for()
    eventually(lambda: tune.page.locator("canvas").count() >= 4, "three charts")
    tune.wait_for_frame()
    tune.screenshot("compare-over-time")
    misses = tune.page.get_by_role("button", name=re.compile(r"^0\.\d{4} s"))
    misses.first.wait_for()
    first = misses.first.inner_text()
    misses.first.click()
    start_us = round(float(first.split(" ")[0]) * 1e6)
    eventually(lambda: 0 <= tune.state.playhead.anchor_us - start_us <= 4000, "the cursor to be at the miss")
    choose(tune, "Answers of", "refined")
    eventually(lambda: misses.first.inner_text() != first, "the misses of refined")
    misses.first.click()
    eventually(lambda: tune.state.tune.method == "refined", "the method whose miss it is")
    tune.press("false")
    tune.page.get_by_text("answers are wrong").wait_for()
    tune.screenshot("compare-false")
    use_refined(tune, config)
    for reference in ("refined", "fe-fusion"):  # one of those that are compared, and one that is not
        choose(tune, "Reference", reference)
        choose(tune, "Over", "0.4 s around the cursor")
        tune.press("Compare over time")
        tune.page.get_by_text(f"agreement with {reference}, not error").wait_for()
        tune.wait_for_frame()
        tune.screenshot(f"compare-agreement-{reference}")
        if reference == "refined":
            tune.press("missed")
            tune.page.get_by_text(re.compile(r"No misses at [\d,]+ times, if refined is right")).wait_for()
            assert misses.count() == 0
            tune.screenshot("compare-no-misses")
    tune.field("Show the result").click()
    tune.page.get_by_text("agreement with fe-fusion").wait_for(state="hidden")


def methods_stand_beside_each_other_on_the_same_window(tune) -> None:
    click_all(tune, "ebpp", "Side by side")
    eventually(lambda: len(tune.session.sheet.pictures) == 3, "three pictures")
    assert len({picture.region for picture in tune.session.sheet.pictures}) == 1
    tune.page.get_by_text("refined: ").first.wait_for()
    tune.wait_for_pixels("side-by-side", lambda canvas: count_like(canvas, GREEN) > 40 < count_like(canvas, YELLOW))
    click_all(tune, "paper", "fe-fusion")
    eventually(lambda: len(tune.session.sheet.pictures) == 5, "five pictures")
    tune.wait_for_pixels("side-by-side-all", lambda canvas: count_like(canvas, (255, 130, 210), 30) > 40)
    click_all(tune, "ebpp", "paper", "fe-fusion", "Side by side")
    eventually(lambda: len(tune.session.sheet.pictures) == 1, "one picture again")


@pytest.mark.gate
def test_stages_settings_and_methods_change_what_is_found(tune) -> None:
    tune.session.send(SetZoom(3.0))  # where the picture is as wide as the sensor a ball's outline is a pixel
    eventually(lambda: region_of(tune).width < 500, "the nearer view")
    the_stages_show_the_ball_its_hull_and_its_circle(tune)
    a_slider_changes_the_overlay_and_undo_brings_it_back(tune)
    another_method_shows_its_ball_its_own_stages_and_sliders(tune)


def test_the_zoomed_view_and_the_clusters_lead_to_the_ball(tune) -> None:
    zoom_follows_the_ball_and_a_click_centres_it_elsewhere(tune)
    a_click_on_a_cluster_puts_its_row_first(tune)
    a_rejected_ball_stays_in_view_in_red_and_its_verdict_leads_to_its_sliders(tune)


def test_sliders_are_in_reach_and_two_configs_are_compared(tune) -> None:
    for stage in ("cluster", "geometry"):
        sliders_of_the_stage_that_is_shown_and_four_clusters_are_seen_without_scrolling(tune, stage)
    use_defaults(tune)
    two_configs_are_compared_on_one_window(tune)


def test_numbers_are_typed_and_configs_are_saved(tune, workspace, monkeypatch) -> None:
    a_number_is_judged_when_it_is_complete(tune)
    use_defaults(tune)
    a_number_may_be_typed_through_values_that_do_not_go_with_the_others(tune, monkeypatch)
    use_defaults(tune)
    what_was_typed_just_before_a_click_is_not_lost(tune, workspace)
    a_config_is_saved_under_a_plain_name_and_loads_again(tune, workspace)


def test_methods_are_compared_on_a_window_and_over_the_recording(tune) -> None:
    tune.page.get_by_text("Compare methods", exact=True).click()
    methods_stand_beside_each_other_on_the_same_window(tune)
    methods_are_compared_over_the_recording_and_a_click_on_a_miss_jumps_there(tune)


def test_a_config_is_scored_and_tuned(tune) -> None:
    a_config_is_scored_over_the_recording(tune)
    tune.page.get_by_text("Auto-tune", exact=True).first.click()
    tuning_against_labels_that_there_are_not_says_so(tune)
    tuning_that_is_cancelled_changes_nothing_and_can_be_started_again(tune)
    thresholds_are_tuned_and_the_result_is_b_beside_a(tune)


@pytest.mark.gate
def test_the_default_method_shows_its_stages_and_a_verdict_leads_to_its_slider(window) -> None:
    window.seek(BALL_US)
    window.press("Tune")
    window.page.get_by_text("moves (").first.wait_for()
    for stage in ("search", "edge points", "fit", "track", "result"):
        before = window.session.sheet.pictures[0].png
        window.press(stage)
        eventually(lambda stage=stage: window.state.tune.stage == stage, stage)
        eventually(lambda before=before: window.session.sheet.pictures[0].png != before, f"the picture of {stage}")
    window.press("fit")
    window.fill(window.field("Zoom"), "8")
    window.page.get_by_role("img", name="residuals").first.wait_for()
    window.screenshot("tune-refined-fit")
    window.fill(window.field("points min"), "200")
    window.page.get_by_text("no ball").first.wait_for()
    verdict = window.page.get_by_role("link", name=re.compile(r"edge points \d+ < 200")).first
    verdict.wait_for()
    window.page.get_by_text("refined finds no ball in a sample").wait_for()
    window.screenshot("tune-refined-why-not")
    verdict.click()
    slider = window.page.locator("#setting-refined-points-min")
    eventually(lambda: 0 < slider.bounding_box()["y"] < 720, "the slider of the limit")
    eventually(lambda: slider.evaluate(COLOUR) == "rgb(255, 140, 40)", "its mark")
